import os
import stat
from pathlib import Path

import pymeshlab
import pytest

from bezier_filters.runtime.atomic import atomic_write


def names(folder: Path) -> list[str]:
    return sorted(item.name for item in folder.iterdir())


def test_the_file_appears_whole_under_its_name(tmp_path: Path) -> None:
    target = tmp_path / "mesh.ply"
    with atomic_write(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == ".ply"
        temporary.write_text("half")
        assert not target.exists()
    assert target.read_text() == "half"
    assert names(tmp_path) == ["mesh.ply"]


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_an_existing_file_survives_a_failure(tmp_path: Path, failure: type[BaseException]) -> None:
    target = tmp_path / "mesh.ply"
    target.write_text("old")

    def write_half() -> None:
        with atomic_write(target) as temporary:
            temporary.write_text("half")
            raise failure

    with pytest.raises(failure):
        write_half()
    assert target.read_text() == "old"
    assert names(tmp_path) == ["mesh.ply"]


def test_a_block_that_writes_nothing_is_an_error(tmp_path: Path) -> None:
    target = tmp_path / "mesh.ply"
    target.write_text("old")
    with pytest.raises(FileNotFoundError), atomic_write(target):
        pass
    assert target.read_text() == "old"


@pytest.mark.skipif(os.name == "nt", reason="POSIX permissions")
def test_a_new_file_follows_the_umask_and_a_replaced_one_keeps_its_mode(tmp_path: Path) -> None:
    target = tmp_path / "mesh.ply"
    before = os.umask(0o027)
    try:
        with atomic_write(target) as temporary:
            temporary.write_text("new")
        assert stat.S_IMODE(target.stat().st_mode) == 0o640
        target.chmod(0o600)
        with atomic_write(target) as temporary:
            temporary.write_text("newer")
        assert stat.S_IMODE(target.stat().st_mode) == 0o600
    finally:
        os.umask(before)


@pytest.mark.skipif(os.name == "nt", reason="symbolic links")
def test_a_link_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    target = tmp_path / "data" / "mesh.ply"
    target.write_text("old")
    link = tmp_path / "link.ply"
    link.symlink_to(target)
    with atomic_write(link) as temporary:
        assert temporary.parent == target.parent
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_missing_directory_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(FileNotFoundError, match=r"there is no directory .*nowhere"),
        atomic_write(tmp_path / "nowhere/a"),
    ):
        pytest.fail("the block must not run")


def test_a_directory_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="not a regular file"), atomic_write(tmp_path):
        pytest.fail("the block must not run")


def test_pymeshlab_takes_the_format_from_the_temporary_name(tmp_path: Path) -> None:
    meshes = pymeshlab.MeshSet()
    meshes.create_cube()
    for name, start in (("cube.ply", b"ply\n"), ("cube.off", b"NOFF\n")):
        with atomic_write(tmp_path / name) as temporary:
            meshes.save_current_mesh(str(temporary))
        assert (tmp_path / name).read_bytes().startswith(start)
