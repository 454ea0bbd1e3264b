"""Pure compiled functions of arrays: no scene, no model, no Python objects."""
