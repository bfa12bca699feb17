"""Properties that are computed once, by threads that do not wait for each other."""

import functools
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from functools import cached_property as cached_property
else:

    class cached_property(functools.cached_property):
        """`functools.cached_property` as it is since Python 3.12: without a lock.

        Before that, one lock is shared by all instances of a class, and a process that is forked while another thread
        holds it waits for ever.
        """

        def __get__(self, instance: Any, owner: Any = None) -> Any:
            """Value of an instance; two threads may both compute it."""
            if instance is None:
                return self
            values = instance.__dict__
            if self.attrname not in values:
                values[self.attrname] = self.func(instance)
            return values[self.attrname]
