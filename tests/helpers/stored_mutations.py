"""Damage to files that are kept between runs, the same for the same seed."""

import os

MOST = 4  # files that are damaged at a time


def lose(path, rng):
    path.unlink()


def empty(path, rng):
    os.truncate(path, 0)


def cut(path, rng):
    os.truncate(path, rng.integers(path.stat().st_size) if path.stat().st_size else 0)


def flip(path, rng):
    """Change one bit, under the old time and size."""
    data, status = bytearray(path.read_bytes()), path.stat()
    if data:
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
    path.write_bytes(data)
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def exchange(path, rng):
    """Give it the content of another file of its folder."""
    others = sorted(other for other in path.parent.iterdir() if other.is_file() and other != path)
    if others:
        path.write_bytes(others[rng.integers(len(others))].read_bytes())


DAMAGES = (lose, empty, cut, flip, exchange)


def damage_files(folder, rng, *, most=MOST, damages=DAMAGES):
    """Damage some of the files below a folder; what was done, in words."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    done = []
    for index in rng.choice(len(files), min(len(files), rng.integers(1, most + 1)), replace=False):
        damage = damages[rng.integers(len(damages))]
        if files[index].exists():
            damage(files[index], rng)
        done.append(f"{damage.__name__} {files[index].name}")
    return done
