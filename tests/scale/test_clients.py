"""Runs in tiles use the scheduler that the user has, however it is given, and leave it as it was."""

import json
import os
import subprocess
import sys
import time

import dask
import distributed
import fsspec
import pytest
from scale_cases import assert_same_as_in_memory, clean, save_arrays
from typer.testing import CliRunner

from bezier_filters.cli.commands import app
from bezier_filters.errors import InvalidParameterError
from bezier_filters.scale import FitOptions, estimate_file, smooth_file
from bezier_filters.scale.clients import CONNECT_SECONDS, probe_worker
from bezier_filters.scale.scheduling import run_tasks

GIVEN = {"rings": 2, "alpha": 0.8}  # fits that need not be chosen
OPTIONS = {"options": FitOptions(**GIVEN), "tile_vertices": 256}


@pytest.fixture(scope="module")
def scheduler_file(tmp_path_factory):
    return tmp_path_factory.mktemp("scheduler") / "scheduler.json"


@pytest.fixture(scope="module")
def cluster(scheduler_file):
    """Two processes, each with a thread; the scheduler writes its file."""
    options = {"n_workers": 2, "threads_per_worker": 1, "host": "127.0.0.1", "dashboard_address": ":0"}
    files = {"scheduler_kwargs": {"scheduler_file": str(scheduler_file)}}
    with distributed.LocalCluster(**options, **files, silence_logs=50) as found:
        yield found


@pytest.fixture
def client(cluster):
    """A client that is no default."""
    with distributed.Client(cluster, set_as_default=False) as found:
        yield found


@pytest.fixture
def files(tmp_path):
    return save_arrays(tmp_path, *clean())


def assert_ran_on(report, cluster):
    """The report names the cluster, and the values are those in memory."""
    assert report["scheduler"] == cluster.scheduler_address
    assert report["dashboard"].startswith("http://")
    assert_same_as_in_memory(report, *clean(), **GIVEN)


@pytest.mark.parametrize("how", ["cluster", "client", "address", "host and port", "file"])
def test_a_scheduler_is_given_in_any_way_of_dask(how, cluster, client, scheduler_file, files, tmp_path):
    schedulers = {
        "cluster": cluster,
        "client": client,
        "address": cluster.scheduler_address,
        "host and port": cluster.scheduler_address.removeprefix("tcp://"),
        "file": scheduler_file,
    }
    assert_ran_on(estimate_file(files, tmp_path / "out.ply", scheduler=schedulers[how], **OPTIONS), cluster)
    assert client.status == "running"
    assert client.submit(abs, -2).result() == 2


def test_the_dashboard_is_reported_before_the_first_tile(cluster, files, tmp_path):
    seen = []
    report = estimate_file(
        files, tmp_path / "out.ply", scheduler=cluster, progress=lambda name, *_: seen.append(name), **OPTIONS
    )
    assert seen.index(f"dashboard {report['dashboard']}") < seen.index("fit")


def test_clients_of_ours_are_closed_and_those_of_users_are_not(cluster, client, files, tmp_path):
    for scheduler in (cluster, cluster.scheduler_address, client):
        estimate_file(files, tmp_path / "out.ply", scheduler=scheduler, **OPTIONS)
    names = [name for name in cluster.scheduler.clients if name.startswith("Client-")]
    assert names == [client.id]


def test_the_current_client_is_used_and_stays(cluster, files, tmp_path):
    with distributed.Client(cluster) as current:
        assert_ran_on(estimate_file(files, tmp_path / "out.ply", **OPTIONS), cluster)
        report = smooth_file(files, tmp_path / "smooth.ply", "paper", tile_vertices=256)
        assert report["scheduler"] == cluster.scheduler_address
        assert distributed.default_client() is current
        assert current.status == "running"
        with dask.config.set(scheduler="single-threaded"):  # as for other collections, this comes first
            report = estimate_file(files, tmp_path / "local.ply", **OPTIONS)
        assert (report["scheduler"], report["dashboard"]) == ("synchronous", None)


def test_a_task_uses_the_cluster_that_it_runs_on(cluster, client, files, tmp_path):
    """Both workers may wait in such a task while its tiles are computed."""
    targets = [tmp_path / f"{k}.ply" for k in range(2)]
    futures = [client.submit(estimate_file, files, target, pure=False, **OPTIONS) for target in targets]
    for report in client.gather(futures):
        assert_same_as_in_memory(report, *clean(), **GIVEN)
        assert report["scheduler"] == cluster.scheduler_address


def test_commands_take_a_scheduler_file(cluster, scheduler_file, files, tmp_path):
    command = ["scale", "curvature", files[0], tmp_path / "out.ply", "--faces", files[1], "--tile-vertices", "256"]
    command += ["--rings", "2", "--alpha", "0.8", "--json", "--scheduler-file", scheduler_file]
    done = CliRunner().invoke(app, [*map(str, command)])
    assert done.exception is None
    assert_ran_on(json.loads(done.stdout), cluster)
    for name in (["scale", "curvature"], ["scale", "smooth"], ["batch", "curvature", "--out", str(tmp_path)]):
        both = [*name, str(files[0]), str(tmp_path / "o.ply"), "--scheduler", "threads", "--scheduler-file", "s.json"]
        assert "give one of them" in str(CliRunner().invoke(app, both).exception)


def test_commands_use_the_scheduler_of_the_environment(cluster, files, tmp_path):
    """Which Dask reads when it is loaded."""
    command = [sys.executable, "-m", "bezier_filters", "scale", "curvature", files[0], tmp_path / "out.ply"]
    command += ["--faces", files[1], "--tile-vertices", "256", "--rings", "2", "--alpha", "0.8", "--json"]
    environment = os.environ | {"DASK_SCHEDULER_ADDRESS": cluster.scheduler_address}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert_ran_on(json.loads(done.stdout), cluster)


@pytest.mark.parametrize(
    ("scheduler", "message"),
    [
        ("tcp://127.0.0.1:1", r"no Dask scheduler responds at tcp://127\.0\.0\.1:1;"),
        ("tcp://nowhere.invalid:8786", r"no Dask scheduler responds at tcp://nowhere\.invalid:8786;"),
        ("smb://nowhere:1", "no Dask scheduler responds at smb://nowhere:1; unknown address scheme"),
        ("127.0.0.1", "expected threads, .* a scheduler file, a cluster, or a Client"),
        ("no.json", "cannot read no.json: there is no such file"),
    ],
)
def test_a_scheduler_that_does_not_respond_is_named(scheduler, message, files, tmp_path, monkeypatch):
    assert CONNECT_SECONDS <= 5.0
    monkeypatch.setattr("bezier_filters.scale.clients.CONNECT_SECONDS", 0.5)
    start = time.monotonic()
    with pytest.raises(InvalidParameterError, match=rf"^scheduler: .*{message}"):
        estimate_file(files, tmp_path / "out.ply", scheduler=scheduler, **OPTIONS)
    assert time.monotonic() - start < 2.0
    assert sorted(tmp_path.iterdir()) == sorted(files)


def test_a_closed_client_and_a_damaged_scheduler_file_are_refused(cluster, files, tmp_path, monkeypatch):
    monkeypatch.setattr("bezier_filters.scale.clients.CONNECT_SECONDS", 0.2)
    with distributed.Client(cluster, set_as_default=False) as closed:
        pass
    (tmp_path / "half.json").write_text('{"type": "Scheduler", ')
    for scheduler, message in ((closed, "Client that is closed"), (tmp_path / "half.json", "it is no scheduler file")):
        with pytest.raises(InvalidParameterError, match=rf"^scheduler: .*{message}"):
            estimate_file(files, tmp_path / "out.ply", scheduler=scheduler, **OPTIONS)


def test_worker_processes_read_ranges_of_a_common_store(client, files, tmp_path):
    """file:// is remote for the package; memory:// is not common to processes."""
    given = {"scheduler": client} | OPTIONS
    report = estimate_file(files, tmp_path / "out.ply", store=f"file://{tmp_path}/tiles", **given)
    assert_same_as_in_memory(report, *clean(), **GIVEN)
    with pytest.raises(InvalidParameterError, match=r"^store: worker tcp://.* does not see memory://tiles/bezier"):
        estimate_file(files, tmp_path / "no.ply", store="memory://tiles", **given)
    fsspec.filesystem("memory").rm("/tiles", recursive=True)


def test_workers_without_the_package_are_named(client, files, tmp_path):
    """Modules that are None cannot be imported."""

    def hide():
        import sys

        hidden = {name: sys.modules.pop(name) for name in list(sys.modules) if name.split(".")[0] == "bezier_filters"}
        sys.hidden_modules = hidden
        sys.modules["bezier_filters"] = None

    def show():
        import sys

        sys.modules.pop("bezier_filters")
        sys.modules.update(sys.hidden_modules)

    client.run(hide)
    try:
        with pytest.raises(InvalidParameterError, match=r"^scheduler: worker tcp://.* has no module 'bezier_filters'"):
            estimate_file(files, tmp_path / "out.ply", scheduler=client, **OPTIONS)
        with pytest.raises(InvalidParameterError, match=r"^scheduler: a worker has no module 'bezier_filters'"):
            list(run_tasks(client, probe_worker, [None]))
    finally:
        client.run(show)
