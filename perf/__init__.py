"""Measurements of fastbeam, none of which is part of the package. Commands are run as files: `python perf/suite/regression.py`.

- `suite`: what every change is held against: the benchmark suite, other revisions in time and in bits, times and margins of tests
- `limits`: operations, bytes and times of an iteration against what the machine allows, and the goals of the project
- `cases`: times of one part or one kind of scene each
- `peers`: the same scenes with other programs
- `stress`: attempts to break the package
- `validation`: every bar of accuracy

Modules are imported from the top of the repository, as `perf.suite.compare`, which commands put on the path. `machine`, `places`,
`printing` and `processes` are for all of them.
"""
