"""Machine code that a wheel carries, compiled for all processors of its platform.

`tools/compile_wheel.py` makes it when the wheel is built. It is used where the processor has all features that it needs
and the installed compiler is the one that made it; otherwise functions are compiled on this machine. It comes before
code that was compiled here, so that all machines with the same wheel compute the same bits.
"""

import platform
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import llvmlite.binding
from numba import config

from bezier_filters.runtime.kernel_key import KEY_DIGITS, PACKAGE, kernel_key

CODE_FOLDER = PACKAGE / "machine_code"


@dataclass(frozen=True)
class Processor:
    """A processor as LLVM describes it."""

    name: str
    features: tuple[str, ...]  # which a machine must have; those of the architecture itself need not be listed

    @property
    def flags(self) -> str:
        """The features as numba passes them to LLVM, and as they are part of the names of cached files."""
        return ",".join(f"+{feature}" for feature in self.features)


_V3 = """
avx avx2 bmi bmi2 crc32 cx16 f16c fma lzcnt movbe popcnt sahf sse sse2 sse3 sse4.1 sse4.2 ssse3 xsave
"""  # level 3 of the System V ABI of x86-64: Intel since 2013, AMD since 2015
GENERIC_PROCESSORS = {
    "x86_64": Processor("x86-64-v3", tuple(_V3.split())),
    "amd64": Processor("x86-64-v3", tuple(_V3.split())),  # as Windows names it
    "aarch64": Processor("generic", ("fp-armv8", "neon")),  # level 0 of ARMv8
    "arm64": Processor("apple-m1", ()),  # the first one of that platform
}
"""The processors that wheels are compiled for, by `platform.machine`."""


def generic_processor() -> Processor | None:
    """The processor that wheels for this platform are compiled for, if there are any."""
    return GENERIC_PROCESSORS.get(platform.machine().lower())


@cache
def find_shipped_code() -> Path | None:
    """Folder with code of the current key that this processor can run, or None.

    A processor that the user has set, with ``NUMBA_CPU_NAME`` or ``NUMBA_CPU_FEATURES``, is respected.
    """
    processor = generic_processor()
    folder = CODE_FOLDER / kernel_key()[:KEY_DIGITS]
    if processor is None or not kernel_key() or not folder.is_dir():
        return None
    is_chosen = getattr(config, "CPU_NAME", None) is not None or getattr(config, "CPU_FEATURES", None) is not None
    return folder if not is_chosen and has_features(processor) else None


def has_features(processor: Processor) -> bool:
    """Whether this machine has all features of a processor."""
    here = llvmlite.binding.get_host_cpu_features()
    return all(here.get(feature, False) for feature in processor.features)
