"""Libraries of extras, imported where they are needed."""

from importlib import import_module
from typing import Any

CONVERT = '"bezier-filters[convert]"'


def import_extra(name: str, what: str = CONVERT) -> Any:
    """Import a library; ImportError with what to install if it is missing."""
    try:
        return import_module(name)
    except ImportError as error:
        raise ImportError(f"{name} is missing: pip install {what} ({error})") from error
