"""Cached properties without a lock."""

import functools
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from functools import cached_property as cached_property
else:

    class cached_property(functools.cached_property):
        """`functools.cached_property` as in Python 3.12 and later: without a lock.

        Earlier versions share one lock among all instances of a class. A process that is forked while another thread
        holds it deadlocks.
        """

        def __get__(self, instance: Any, owner: Any = None) -> Any:
            """Value of an instance; two threads may both compute it."""
            if instance is None:
                return self
            values = instance.__dict__
            if self.attrname not in values:
                values[self.attrname] = self.func(instance)
            return values[self.attrname]
