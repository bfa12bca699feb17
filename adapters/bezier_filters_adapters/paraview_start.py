"""ParaView with the filters: a script for `paraview --script`, and a module for pvpython; both load the plugin.

ParaView 5.11 imports a function from `inspect` that Python 3.11 does not have any more, and so loads no plugin in
Python. This brings the function back before.
"""

import inspect
from importlib.util import find_spec

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec  # type: ignore[attr-defined]

from paraview import simple

_PLUGIN = find_spec("bezier_filters_paraview")
assert _PLUGIN is not None
simple.LoadPlugin(_PLUGIN.origin, remote=False, ns=vars(simple))
