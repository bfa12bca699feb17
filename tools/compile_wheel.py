"""Build hook of hatchling: a wheel with the machine code of all kernels, for one platform and one Python.

    HATCH_BUILD_HOOK_ENABLE_CUSTOM=1 python -m build --wheel

Without that variable the wheel is the same for all platforms, and compiles its kernels where it runs. The compiler is
the numba of the environment of the build, so the code is for that version; `bezier_filters/runtime/shipped_code.py`
decides where it is used.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

COMPILE = """
from bezier_filters.compilation import compile_kernels
from bezier_filters.runtime.kernel_folders import kernel_folders
done = compile_kernels()
print(f"{done.functions} compiled functions, {done.size / 1e6:.1f} MB, {done.seconds:.1f} s")
print(kernel_folders().writable)
"""
ASK = """
from bezier_filters.runtime.shipped_code import generic_processor
print(generic_processor().name, generic_processor().flags)
"""
GLIBC = "2_17"  # of which the code needs nothing; numba's wheels need this version or a later one


class CompileWheel(BuildHookInterface[Any]):
    """Adds the machine code to a wheel, and the platform to its name."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels for a generic processor of this platform, into a folder of the wheel."""
        if self.target_name != "wheel" or version == "editable":
            return
        self._folder = tempfile.mkdtemp()
        name, _, flags = self._run(ASK).strip().partition(" ")
        code = Path(self._run(COMPILE, NUMBA_CPU_NAME=name, NUMBA_CPU_FEATURES=flags).splitlines()[-1])
        key = code.name.rpartition("-")[2]
        for file in sorted(code.glob("*.nbc")):
            build_data["force_include"][str(file)] = f"bezier_filters/machine_code/{key}/{file.name}"
        python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
        build_data["pure_python"] = False
        build_data["tag"] = f"{python}-none-{platform_tag()}"

    def finalize(self, _version: str, _build_data: dict[str, Any], _path: str) -> None:
        """Delete the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)

    def _run(self, code: str, **variables: str) -> str:
        """Output of code that runs on the package of this tree."""
        environment = os.environ | variables | {"PYTHONPATH": self.root, "NUMBA_CACHE_DIR": self._folder}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=self._folder,
            stdout=subprocess.PIPE,
            text=True,
            check=True,
        )
        print(done.stdout, file=sys.stderr)
        return done.stdout


def platform_tag() -> str:
    """Platform in the name of the wheel, as package indices accept it."""
    system = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    return system.replace("linux", f"manylinux_{GLIBC}", 1)
