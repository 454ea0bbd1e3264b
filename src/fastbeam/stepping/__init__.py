"""One step of a model: its terms, Newton's method, condensed nets and the fallback."""

__all__: list[str] = []
