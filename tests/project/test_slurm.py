"""Examples for SLURM, as far as they can be tested without it."""

import importlib.util
import os
import re
import signal
import subprocess
import sys

import psutil
import pytest
from support.missions import archive_bytes
from support.repository import REPOSITORY

from benchmarks.clusters import freeze_when, signal_group, wait_until
from gliderhpc.store_schema import read_commits

pytestmark = pytest.mark.compiled

EXAMPLES = REPOSITORY / "examples"

SRUN = """#!/bin/bash
# Two tasks, on this machine, that end when signalled.
trap 'kill $first $second' TERM
"$@" & first=$!
"$@" & second=$!
wait
"""


@pytest.fixture
def slurm(tmp_path):
    """Environment in which `srun` starts two processes here and `scontrol` prints its arguments."""
    tools = tmp_path / "tools"
    tools.mkdir()
    python = "-c 'import sys; from gliderhpc.cli import main; main(sys.argv[1:])'"
    for name, text in {
        "srun": SRUN,
        "scontrol": '#!/bin/bash\necho "scontrol $@"\n',
        "dask": f'#!/bin/bash\nexec {sys.executable} -m dask "$@"\n',
        "gliderhpc": f'#!/bin/bash\nexec {sys.executable} {python} "$@"\n',
    }.items():
        (tools / name).write_text(text)
        (tools / name).chmod(0o755)
    return {
        **os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}", "SLURM_JOB_ID": "17",
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }  # fmt: skip


@pytest.mark.long
def test_the_batch_script_runs_a_mission_and_goes_on_where_it_was_stopped(brief, brief_store, slurm, tmp_path):
    """SIGTERM before the time is up: the run ends with 130 and is queued again; the second job finishes it."""
    store = tmp_path / "mission.zarr"
    command = ["bash", str(EXAMPLES / "slurm.sh"), str(brief), "petrel-l", str(store)]

    def start():
        return subprocess.Popen(
            command, cwd=tmp_path, env=slurm, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip

    job = start()
    wait_until(lambda: job.poll() is not None or (store / "zarr.json").exists())
    freeze_when(job, lambda: len(read_commits(store)) > 0, step=0.001)
    job.send_signal(signal.SIGTERM)
    # The workers stay frozen until the run has ended: they would otherwise be done before it stops.
    for process in [psutil.Process(job.pid), *psutil.Process(job.pid).children(recursive=True)]:
        if "worker" not in process.cmdline():
            process.send_signal(signal.SIGCONT)
    job.wait(timeout=400)
    # A worker that goes on may still write the dive that it had finished.
    stopped_with = len(read_commits(store))
    signal_group(job, signal.SIGCONT)
    out, err = job.communicate(timeout=400)
    assert job.returncode == 130, err
    assert "scontrol requeue 17" in out
    assert stopped_with < 3
    job = start()
    out, err = job.communicate(timeout=400)
    assert job.returncode == 0, err
    assert out.splitlines()[-1] == "done"
    assert archive_bytes(store) == archive_bytes(brief_store)


def test_the_batch_script_asks_slurm_for_what_the_page_says():
    page, script = (REPOSITORY / "docs" / "clusters.md").read_text(), (EXAMPLES / "slurm.sh").read_text()
    for directive in re.findall(r"^#SBATCH (--[a-z-]+)", script, re.MULTILINE):
        assert directive in page or directive in ("--job-name", "--mem-per-cpu", "--cpus-per-task")


def _example():
    spec = importlib.util.spec_from_file_location("slurm_workers", EXAMPLES / "slurm_workers.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.filterwarnings("ignore")
def test_the_job_script_starts_one_thread_workers():
    pytest.importorskip("dask_jobqueue", reason="the extra 'slurm' is not installed")
    example = _example()
    with example.slurm_cluster("short", "01:30:00") as cluster:
        script = cluster.job_script()
    for line in ("#SBATCH -p short", "#SBATCH -t 01:30:00", "#SBATCH --cpus-per-task=16", "export OMP_NUM_THREADS=1"):
        assert line in script
    worker = next(line for line in script.splitlines() if "dask_worker" in line or "dask worker" in line)
    assert "--nthreads 1 " in worker
    assert f"--nworkers {example.WORKERS_A_JOB}" in worker


@pytest.mark.long
def test_the_example_runs_a_mission_on_a_replacement(brief, brief_store, tmp_path):
    """A cluster of this machine in SLURM's place."""
    code = f"""
if __name__ == "__main__":
    import importlib.util, sys
    from distributed import LocalCluster
    spec = importlib.util.spec_from_file_location("slurm_workers", {str(EXAMPLES / "slurm_workers.py")!r})
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)

    class StandIn(LocalCluster):
        def scale(self, jobs):
            super().scale(jobs)

    with StandIn(n_workers=0, threads_per_worker=1, dashboard_address=None) as cluster:
        example.run_on(cluster, 2, sys.argv[1:])
"""
    script, store = tmp_path / "replacement.py", tmp_path / "mission.zarr"
    script.write_text(code)
    done = subprocess.run(
        [sys.executable, script, "run-mission", brief, "--platform", "petrel-l", "--store", store], text=True,
        capture_output=True, check=False, timeout=400, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert archive_bytes(store) == archive_bytes(brief_store)
