"""For the pages of docs/api: signatures of parts of scenes, which `@noun` makes of their fields, as `help()` shows them; and the
public names of the package, which are those of its packages."""
from __future__ import annotations

import inspect
from importlib import import_module
from typing import Any

from griffe import Alias, Class, Extension, Function, Module, Parameter, ParameterKind, Parameters

KINDS = {inspect.Parameter.POSITIONAL_ONLY: ParameterKind.positional_only,
         inspect.Parameter.POSITIONAL_OR_KEYWORD: ParameterKind.positional_or_keyword,
         inspect.Parameter.VAR_POSITIONAL: ParameterKind.var_positional,
         inspect.Parameter.KEYWORD_ONLY: ParameterKind.keyword_only,
         inspect.Parameter.VAR_KEYWORD: ParameterKind.var_keyword}


class Signatures(Extension):
    """Gives classes of scenes the constructor that they have, and the package its public names."""

    def on_package(self, *, pkg: Module, **more: Any) -> None:
        """Called by griffe when a package is read."""
        if pkg.path == "fastbeam":
            for name, module in import_module("fastbeam.interface.lazy_import").names_of("fastbeam").items():
                pkg.set_member(name, Alias(name, f"{module}.{name}"))

    def on_class(self, *, cls: Class, **more: Any) -> None:
        """Called by griffe when a class and its members are read."""
        if "__init__" in cls.members or not any("noun" in str(decorator.value) for decorator in cls.decorators):
            return
        thing = getattr(import_module(cls.module.canonical_path), cls.name)
        taken = [Parameter(p.name, kind=KINDS[p.kind], default=None if p.default is p.empty else repr(p.default))
                 for p in inspect.signature(thing).parameters.values()]
        own = Parameter("self", kind=ParameterKind.positional_or_keyword)
        cls.set_member("__init__", Function("__init__", parameters=Parameters(own, *taken)))
