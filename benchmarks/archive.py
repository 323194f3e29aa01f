"""Archive of a whole mission: cost of writing, size, and time of users' queries.

Usage: ``python -m benchmarks.archive RUN.zarr [--profiles 565] [--work FOLDER] [--quick]``. RUN is the archive of some of
a mission's profiles. They are written row by row into an archive of the whole mission's size, in turn, so that sizes
and times are those of the mission. The page is ``docs/archive.md``.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec, ZstdCodec

from benchmarks.archive_queries import QUERIES, Query
from benchmarks.archive_schema import PAGE
from benchmarks.machine import machine_row
from benchmarks.mission import folder_bytes
from benchmarks.sections import with_section
from gliderhpc.findings.formatting import markdown
from gliderhpc.mission.planning import SECONDS_PER_STEP
from gliderhpc.store_schema import (
    MISSION,
    ArchiveRows,
    check_archive,
    create_archive,
    write_mission_table,
)
from gliderhpc.store_schema.commits import label_of
from gliderhpc.store_schema.create import mission_sizes
from gliderhpc.store_schema.schema import PROFILE
from gliderhpc.vocabulary import CHANNELS

MEBI, KIBI = 2.0**20, 2.0**10
REPEATS = 3
LAYOUT_PROFILES = 16
SHARD = 16
"""Profiles in a shard of the layout that has shards."""


@dataclass(frozen=True)
class Layout:
    """A way to keep one variable of all profiles."""

    name: str
    codecs: tuple[Any, ...]
    dtype: str = "float32"
    separator: str = "."
    parts: int = 1
    shard: int = 1


_SHUFFLED = BloscCodec(cname="zstd", clevel=1, shuffle="shuffle")
CHOSEN = "chosen: float32, shuffled, zstd 1, checksum, one row per chunk"
LAYOUTS = (
    Layout(CHOSEN, (_SHUFFLED, Crc32cCodec())),
    Layout("without checksum", (_SHUFFLED,)),
    Layout("one folder per chunk (c/5/0)", (_SHUFFLED, Crc32cCodec()), separator="/"),
    Layout("zstd 5", (BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"), Crc32cCodec())),
    Layout("lz4", (BloscCodec(cname="lz4", clevel=5, shuffle="shuffle"), Crc32cCodec())),
    Layout("bits shuffled", (BloscCodec(cname="zstd", clevel=1, shuffle="bitshuffle"), Crc32cCodec())),
    Layout("zstd 1, not shuffled", (ZstdCodec(level=1), Crc32cCodec())),
    Layout("float64", (BloscCodec(cname="zstd", clevel=1, shuffle="shuffle"), Crc32cCodec()), dtype="float64"),
    Layout("four chunks per row", (_SHUFFLED, Crc32cCodec()), parts=4),
    Layout(f"shards of {SHARD} profiles, rewritten at the end", (_SHUFFLED, Crc32cCodec()), shard=SHARD),
)


def rewrite(run: Path, out: Path, profiles: int | None = None) -> dict[str, float]:
    """Write a run's profiles in turn until there are `profiles` (its own number); processor seconds and bytes a profile."""
    source = zarr.open_group(str(run), mode="r")
    count = source[PROFILE].shape[0]
    numbers = np.arange(1, (profiles or count) + 1) if profiles else np.asarray(source[PROFILE][:])
    attributes = {**dict(source.attrs), "mission": run.stem}
    create_archive(out, numbers, mission_sizes(run), attributes, overwrite=True)
    rows, table, seconds = ArchiveRows(out), {}, []
    for index in range(len(numbers)):
        at = index % count
        content = {group: dict(values) for group, values in _rows_of(source, at)}
        began = time.process_time()
        rows.begin(index)
        for group, values in content.items():
            rows.write(index, group, values)
        table[index] = _table_row(source, at)
        rows.commit(index, table[index], {}, "2026-01-01T00:00:00+00:00")
        seconds.append(time.process_time() - began)
    began = time.process_time()
    write_mission_table(out, table)
    finishing = time.process_time() - began
    differences = check_archive(out)
    if differences:
        raise RuntimeError(differences[0])
    return {
        "profiles": len(numbers),
        "of": count,
        "seconds": statistics.median(seconds),
        "table": finishing,
        "bytes": folder_bytes(out) / len(numbers),
        "files": sum(1 for path in out.rglob("*") if path.is_file()),
    }


def _rows_of(source: zarr.Group, at: int) -> Iterator[tuple[str, Iterator[tuple[str, Any]]]]:
    for group in MISSION:
        rows = [variable.name for variable in group.variables if variable.is_row]
        if rows:
            yield group.name, ((name, np.asarray(source[label_of(group.name, name)][at])) for name in rows)


def _table_row(source: zarr.Group, index: int) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for variable in MISSION["/"].variables:
        if variable.is_table and variable.name != PROFILE:
            value = np.asarray(source[variable.name][index : index + 1])[0]
            if variable.dtype == "string":
                row[variable.name] = str(value)
            elif np.isfinite(value):
                row[variable.name] = value.item()
    return row


_MEMORY = """\
def kibibytes(what):
    with open("/proc/self/status") as status:
        return next(int(line.split()[1]) for line in status if line.startswith(what))
"""
"""Memory of a process, and its largest value since that was last reset."""


def ask(query: Query, archive: Path) -> tuple[float, float, float, str]:
    """Seconds, processor seconds and added MiB of a query in a separate process, without imports; its output."""
    code = (
        f"{_MEMORY}import time\nimport dask.array\nimport numpy as np\nimport xarray as xr\nimport zarr\n"
        f"archive = {str(archive)!r}\nbefore = kibibytes('VmRSS')\nopen('/proc/self/clear_refs', 'w').write('5')\n"
        "began, worked = time.perf_counter(), time.process_time()\n"
        f"{query.code}\n"
        "seconds, worked = time.perf_counter() - began, time.process_time() - worked\n"
        "print(seconds, worked, (kibibytes('VmHWM') - before) / 1024)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *shown, measured = done.stdout.rstrip().splitlines()
    seconds, worked, memory = map(float, measured.split())
    return seconds, worked, memory, "\n".join(shown)


def measure_layouts(run: Path, work: Path, profiles: int) -> list[dict[str, Any]]:
    """Size and times of every layout for two variables of some profiles: one that a query reads, and its depth."""
    source = zarr.open_group(str(run), mode="r")
    profiles = min(profiles, source[PROFILE].shape[0])
    values = {name: np.asarray(source[f"series/{name}"][:profiles]) for name in ("B_cu", "depth")}
    # The archive keeps single precision; double precision had other low bits, which noise stands for here.
    noise = np.random.default_rng(0).standard_normal(values["B_cu"].shape) * 1e-9
    return [_measured(layout, values, noise, work) for layout in LAYOUTS]


def _measured(layout: Layout, values: Mapping[str, Any], noise: Any, work: Path) -> dict[str, Any]:
    folder = work / "layout.zarr"
    shutil.rmtree(folder, ignore_errors=True)
    writing = _write_layout(layout, values, noise, folder)
    reading = []
    for _ in range(REPEATS):
        began = time.process_time()
        with xr.open_dataset(folder, engine="zarr", chunks={}, consolidated=False) as opened:
            inside = (opened["depth"] > 50.0) & (opened["depth"] < 150.0)
            opened["B_cu"].where(inside).mean().compute()
        reading.append(time.process_time() - began)
    count = len(values["depth"])
    files = sum(1 for path in folder.rglob("*") if path.is_file() and path.name != "zarr.json")
    return {
        "layout": layout.name,
        "write": 1e3 * writing / count,
        "read": 1e3 * statistics.median(reading) / count,
        "kib": folder_bytes(folder) / count / KIBI,
        "files": files / count,
    }


def _write_layout(layout: Layout, values: Mapping[str, Any], noise: Any, folder: Path) -> float:
    """Write row by row; a layout with shards is rewritten by one writer, as shards cannot be shared. Seconds."""
    root = zarr.create_group(str(folder))
    seconds = 0.0
    for name, rows in values.items():
        content = rows.astype(layout.dtype) + (noise if layout.dtype == "float64" else 0.0)
        length = rows.shape[1]
        common: dict[str, Any] = {
            "shape": rows.shape,
            "dtype": layout.dtype,
            "compressors": layout.codecs,
            "fill_value": np.nan,
            "dimension_names": ("profile", "sample"),
            "chunks": (1, -(-length // layout.parts)),
            "chunk_key_encoding": {"name": "default", "separator": layout.separator},
        }
        began = time.process_time()
        array = root.create_array(name if layout.shard == 1 else f"{name}_rows", **common)
        for index in range(len(rows)):
            array[index, :] = content[index]
        if layout.shard > 1:
            sharded = root.create_array(name, shards=(layout.shard, common["chunks"][1]), **common)
            for first in range(0, len(rows), layout.shard):
                sharded[first : first + layout.shard] = array[first : first + layout.shard]
            del root[f"{name}_rows"]
        seconds += time.process_time() - began
    return seconds


def rounding(run: Path) -> list[tuple[str, float, float]]:
    """Largest rounding by single precision and median standard deviation of each smoothed quantity."""
    with xr.open_datatree(run, engine="zarr") as tree:
        smoothed = tree["smoothed"].to_dataset().load()
    found = []
    for name in (*CHANNELS, "roll", "pitch", "heading", "depth", "u", "X"):
        largest = np.nanmax(np.abs(smoothed[name].values))
        found.append((name, float(np.spacing(np.float32(largest)) / 2), float(np.nanmedian(smoothed[f"{name}_std"]))))
    return found


def write_share(run: Path, work: Path) -> tuple[float, float]:
    """Processor seconds of writing a profile of a run again, and their fraction of a profile's total."""
    seconds = rewrite(run, work / "again.zarr")["seconds"]
    with xr.open_datatree(run, engine="zarr") as tree:
        steps = float(np.median(tree["duration"].values)) / float(tree.attrs["step"])
    whole = steps * SECONDS_PER_STEP["lanes", "recommended"]
    return seconds, seconds / (whole + seconds)


def main() -> None:
    """Measure, and write the page's sections."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.archive", description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, metavar="RUN.zarr")
    parser.add_argument("--profiles", type=int, default=565, help="number of profiles in the archive; default 565")
    parser.add_argument(
        "--work", type=Path, help="folder in which the archive is made and retained; default a temporary folder"
    )
    parser.add_argument("--reuse", action="store_true", help="use the archive that is already in --work")
    parser.add_argument("--quick", action="store_true", help="only a few profiles; publishes nothing")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        work = chosen.work or Path(folder)
        work.mkdir(parents=True, exist_ok=True)
        out = work / "mission.zarr"
        if not chosen.reuse:
            found = rewrite(chosen.run, out, 72 if chosen.quick else chosen.profiles)
            (work / "written.json").write_text(json.dumps(found), "utf-8")
        written = json.loads((work / "written.json").read_text("utf-8"))
        layouts = measure_layouts(chosen.run, work, 6 if chosen.quick else LAYOUT_PROFILES)
        answers = [(query, [ask(query, out) for _ in range(REPEATS)]) for query in QUERIES]
        sections = {
            "queries": queries_section(answers, written),
            "layout": layout_section(layouts, written, write_share(chosen.run, work), rounding(chosen.run)),
        }
    text = PAGE.read_text("utf-8")
    for name, section in sections.items():
        text = with_section(text, name, section)
        print(section)
    if not chosen.quick:
        PAGE.write_text(text, "utf-8")


def queries_section(
    answers: list[tuple[Query, list[tuple[float, float, float, str]]]], written: Mapping[str, float]
) -> str:
    """Each query with its output, its time and its memory."""
    machine = machine_row()
    lines = [
        f"On an archive of {written['profiles']:.0f} profiles, which repeat {written['of']:.0f} profiles of a "
        f"mission. {machine['cpu']}, {machine['cores']} cores, load of other work {machine['load']:.1f}, "
        f"{machine['day']}. Times include opening the archive, not Python's imports; the best of {REPEATS} runs, each "
        "in a separate process.",
        "",
    ]
    for query, runs in answers:
        seconds, worked, memory, shown = min(runs)
        lines += [
            f"**{query.title}**: {seconds:.2f} s ({worked:.2f} s of processor time), {memory:.0f} MiB more memory than "
            "after the imports.", "",
            "```python", query.code, "```", "", "```", shown, "```", "",
        ]  # fmt: skip
    return "\n".join(lines).rstrip()


def layout_section(
    layouts: list[dict[str, Any]],
    written: Mapping[str, float],
    share: tuple[float, float],
    rounded: list[tuple[str, float, float]],
) -> str:
    """Compare the layouts, the cost of a profile, and the rounding of single precision."""
    rows = [
        [one["layout"], f"{one['write']:.1f}", f"{one['read']:.1f}", f"{one['kib']:.0f}", f"{one['files']:.2f}"]
        for one in layouts
    ]
    table = markdown(
        ("two variables of group series", "write, processor ms per profile", "depth band, processor ms per profile",
         "KiB per profile", "files per profile"), rows,
    )  # fmt: skip
    precise = markdown(
        ("quantity", "largest rounding", "median standard deviation", "ratio"),
        [[f"`{name}`", f"{one:.1e}", f"{std:.1e}", f"{one / std:.0e}"] for name, one, std in rounded],
    )
    seconds, part = share
    return (
        f"{table}\n\nA profile of the mission takes {written['bytes'] / MEBI:.2f} MiB in "
        f"{written['files'] / written['profiles']:.0f} files. Writing it takes {seconds:.2f} s of processor time, "
        f"manifest and marker included: {part:.1%} of the total for a profile. The table of {written['profiles']:.0f} "
        f"profiles is written in {written['table']:.2f} s.\n\nRounding errors of single precision, and the smoother's "
        f"standard deviations (units of the archive):\n\n{precise}"
    )


if __name__ == "__main__":
    main()
