"""Rounds of tasks, one for each stage: every tile is computed once, and what it has left is read by the next ones."""

import json
import shutil
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bezier_filters.arrays import FloatArray
from bezier_filters.scale.run import Stages
from bezier_filters.scale.scheduling import Workers, run_tasks
from bezier_filters.scale.store import Store
from bezier_filters.scale.tile_results import DamagedTileError, TileResult, look_at_tile, open_tile, tile_path
from bezier_filters.smoothing.accurate_sums import total

GONE = "gone.json"
"""What is left of a stage whose values are not needed any more: its report."""


class ValuesGoneError(RuntimeError):
    """A tile is damaged, and what it was computed from was removed; the run has to begin anew."""


@dataclass
class Rounds:
    """The rounds of a run so far, which is the same again when it is resumed.

    Attributes
    ----------
    workers : Workers
        Where tasks run.
    store : Store
    folder : Path
        For the results.
    stages : Stages
        Seconds and progress.
    threads : int
        Tasks at a time on this machine.
    number : int
        Of rounds so far.
    computed, tiles : int
        Tiles that were computed now, and those of all rounds.
    peak_bytes : int
        The most memory that a worker has had.
    seconds : float
        That tasks have taken.
    halo : float
        Vertices read beyond those of the tiles, per vertex, in the round that read the most.
    damaged : list of str
        Stages and tiles that were not what was written.
    """

    workers: Workers
    store: Store
    folder: Path
    stages: Stages
    threads: int = 1
    number: int = 0
    computed: int = 0
    tiles: int = 0
    peak_bytes: int = 0
    seconds: float = 0.0
    halo: float = 0.0
    damaged: list[str] = field(default_factory=list)

    def next_folder(self, name: str) -> Path:
        """A folder for the next round."""
        self.number += 1
        return self.folder / f"{self.number:03d}-{name}"

    def recalled(self, name: str, find: Callable[[], Any]) -> Any:
        """What a function finds, a number or some, or what it has found before the run was interrupted.

        The values that it looks at may be gone by then.
        """
        path = self.next_folder(name).with_suffix(".json")
        if not path.is_file():
            temporary = path.with_suffix(".tmp")
            temporary.write_text(json.dumps(find()), encoding="utf-8")
            temporary.rename(path)
        return json.loads(path.read_text(encoding="utf-8"))

    def run(
        self, function: Callable[[Any, int], int], job: Any, folder: Path, name: str, needed: Sequence[Path] = ()
    ) -> list[dict[str, Any]]:
        """Compute the tiles that are not there yet; the reports of all.

        Parameters
        ----------
        function : callable
            Task of a tile.
        job : Any
            What all tiles have in common.
        folder : Path
            Where the results go; those whose reports have a mark "has_clusters" go to the folder next to it, too.
        name : str
            Of the stage, for the progress.
        needed : sequence of Path
            Folders of the values that it reads.

        Raises
        ------
        ValuesGoneError
            If a tile is to be computed again for which they are not there any more.
        """
        if (folder / GONE).is_file():
            found: list[dict[str, Any]] = json.loads((folder / GONE).read_text(encoding="utf-8"))
            self._account(found, 0)
            return found
        folder.mkdir(parents=True, exist_ok=True)
        (folder.parent / "clusters").mkdir(exist_ok=True)
        count = self.store.layout.tile_count
        todo = [tile for tile in range(count) if not self._is_there(folder, tile)]
        if todo and any((values / GONE).is_file() for values in needed):
            raise ValuesGoneError(folder.parent.name)
        with self.stages.stage(name) as progress:
            ready = self.workers.ready()
            for _ in run_tasks(ready, function, job, todo, workers=self.threads, progress=progress):
                pass
            with ThreadPoolExecutor(self.threads) as pool:
                reports = list(pool.map(lambda tile: _whole(folder, tile).report, range(count)))
        self._account(reports, len(todo))
        return reports

    def free(self, folder: Path) -> None:
        """Remove the values of a stage; its reports stay."""
        if not folder.is_dir() or (folder / GONE).is_file():
            return
        reports = [look_at_tile(folder, tile).report for tile in range(self.store.layout.tile_count)]
        temporary = folder / f".{GONE}"
        temporary.write_text(json.dumps(reports), encoding="utf-8")
        temporary.rename(folder / GONE)
        for path in folder.glob("tile-*"):
            path.unlink()
        shutil.rmtree(folder.parent / "clusters", ignore_errors=True)

    def _is_there(self, folder: Path, tile: int) -> bool:
        """Whether a tile is whole; what is damaged is named and removed."""
        try:
            _whole(folder, tile)
        except FileNotFoundError:
            return False
        except DamagedTileError:
            self.damaged.append(f"{folder.parent.name}: tile {tile}")
            tile_path(folder, tile).unlink()
            return False
        return True

    def _account(self, reports: list[dict[str, Any]], computed: int) -> None:
        self.tiles += len(reports)
        self.computed += computed
        self.peak_bytes = max([self.peak_bytes, *(int(report.get("peak_bytes", 0)) for report in reports)])
        self.seconds += sum(report.get("seconds", 0.0) for report in reports)
        vertices = sum(report.get("vertices", 0) for report in reports)
        if vertices:
            self.halo = max(self.halo, sum(report["read"] for report in reports) / vertices - 1.0)


def _whole(folder: Path, tile: int) -> TileResult:
    """The results of a tile, checked with what goes with them."""
    found = open_tile(folder, tile)
    if found.report.get("has_clusters"):
        try:
            open_tile(folder.parent / "clusters", tile)
        except FileNotFoundError:
            raise DamagedTileError(f"tile {tile} is damaged: its values on clusters are missing") from None
    return found


def sums_of(reports: list[dict[str, Any]], part_count: int) -> dict[str, FloatArray]:
    """Sums over all tiles."""
    sums = {name: total(np.array([report["sums"][name] for report in reports])) for name in reports[0]["sums"]}
    for name in reports[0]["parts"]:
        found = np.zeros((2, part_count))
        tiles = np.zeros((len(reports), 2, part_count)) if part_count * len(reports) <= 1 << 20 else None
        for tile, report in enumerate(reports):
            parts, values = np.array(report["parts"][name]["parts"], np.int64), report["parts"][name]["sums"]
            if tiles is None:
                found[:, parts] += values
            else:
                tiles[tile][:, parts] = values
        sums[name] = found.sum(axis=0) if tiles is None else total(tiles)
    return sums


def largest_of(reports: list[dict[str, Any]]) -> dict[str, float]:
    """Largest values in any tile."""
    return {name: max(report["largest"][name] for report in reports) for name in reports[0]["largest"]}
