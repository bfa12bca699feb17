"""The docstrings of filters as they are at run time, for the site: tables complete them when a filter is defined."""

import inspect
from importlib import import_module
from typing import Any

from griffe import Docstring, Extension, Function


class CompletedDocstrings(Extension):
    """Takes the docstrings of functions that `complete_docstring` completes from the imported functions."""

    def on_function_instance(self, *, func: Function, **_: Any) -> None:
        """Replace the text that stands in the source."""
        if any(str(decorator.value).startswith("complete_docstring(") for decorator in func.decorators):
            function = getattr(import_module(func.module.path), func.name)
            func.docstring = Docstring(inspect.getdoc(function) or "", parent=func)
