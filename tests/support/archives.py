"""Archives and truth files of known content, written without any estimation."""

import hashlib
import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import zarr

from gliderhpc.estimation.preparation import vibration_set
from gliderhpc.estimation.resample import on_steps
from gliderhpc.mission.profile_rows import observed_row
from gliderhpc.mission.settings import MissionSettings
from gliderhpc.observations import open_observations
from gliderhpc.observations.times import epoch_seconds
from gliderhpc.platform import Platform
from gliderhpc.simulator import ProfileTruth
from gliderhpc.simulator.files import append_truth, truth_file
from gliderhpc.store_schema import (
    MISSION,
    ArchiveRows,
    committed_rows,
    consolidate,
    create_archive,
    write_table_rows,
    write_whole,
)
from gliderhpc.store_schema.commits import as_texts, row_arrays, row_chunks, stored_digests
from gliderhpc.store_schema.location import store_at
from gliderhpc.store_schema.schema import COMMITS, DIGESTS, MANIFEST, study_called
from gliderhpc.store_schema.study_groups import complete_manifests, table_digests

STEP = 0.1
STEPS = 3000
EVERY = 10
CHANNELS = ("B_cu", "B_cv", "B_cw", "B_cp", "B_cq", "B_cr")
TRACKED = ("roll", "pitch", "heading", "depth")


def write_profile(place, profile_index, group, values):
    """Write one profile's row of some variables of a group, as `ArchiveRows.write` does."""
    ArchiveRows(place).write(profile_index, group, values)


def clear_marker(place, profile_index):
    """Clear a profile's commit marker before the profile is computed again."""
    ArchiveRows(place).begin(profile_index)


def schema_digest(path: Path) -> str:
    """Digest of the data that `check_archive` reads: all metadata, and all values of one dimension."""
    digest, folders = hashlib.blake2b(), [str(path)]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in sorted(entries, key=lambda entry: entry.name):
                if entry.is_dir():
                    folders.append(entry.path)
                elif entry.name == "zarr.json" or entry.name.count(".") == 1:
                    content = Path(entry.path).read_bytes()
                    digest.update(f"{entry.path.removeprefix(str(path))} {len(content)} ".encode() + content)
    return digest.hexdigest()


def start_of(number: int) -> np.datetime64:
    """First sample of a profile: one an hour."""
    return np.datetime64("2024-01-01T00:00:00", "ns") + np.timedelta64(number, "h")


def true_disturbances(number: int) -> np.ndarray:
    """Sinusoids of another period a channel, (steps, 6)."""
    time = STEP * np.arange(STEPS)
    return np.column_stack([np.sin(time / (10.0 + channel) + number) for channel in range(6)])


def truth_of(number: int, disturbances: np.ndarray, current=(0.1, -0.2)) -> ProfileTruth:
    """Truth of a profile whose glider rests."""
    rest = np.zeros((2, 12))
    nowhere, epoch = (0.0, 0.0), start_of(number)
    return ProfileTruth(
        number=number, epoch=epoch, duration=STEP * STEPS, step=STEP, disturbances=disturbances,
        time=np.array([0.0, STEP * STEPS]), states=rest, actuators=np.zeros((2, 3)), water=np.zeros((2, 3)),
        water_up=np.zeros(2), levels=np.zeros(1), shear=np.array([current]), current=np.array(current),
        surface_currents=(np.array(current), np.array(current)), displacement=np.zeros(2), course=0.0,
        coefficients={}, net_mass=0.0, impulses=(), entry=nowhere, exit=nowhere, surface_until=epoch, end=nowhere,
    )  # fmt: skip


def write_truth_file(path: Path, *truths: ProfileTruth) -> Path:
    path.unlink(missing_ok=True)
    with truth_file(path, {}) as file:
        for truth in truths:
            append_truth(file, truth)
    return path


@dataclass
class Content:
    """One profile of an archive: an estimate on the samples, motion on the records; change it, then write it."""

    number: int
    adjoint: np.ndarray = None
    prior: np.ndarray = None
    quality: np.ndarray = field(default_factory=lambda: np.zeros(STEPS + 1, np.uint8))
    reconstructed: np.ndarray = None
    measured: np.ndarray = None
    table: dict = field(default_factory=dict)

    def __post_init__(self):
        """Estimates that are the truth, motion that is tracked exactly."""
        for name in ("adjoint", "prior"):
            if getattr(self, name) is None:
                setattr(self, name, true_disturbances(self.number))
        records = np.arange(STEPS // EVERY + 1.0)
        motion = np.column_stack(
            [np.sin(records / 9), -22 + np.sin(records / 7), np.mod(350 + records / 10, 360), records / 5]
        )
        self.reconstructed = motion.copy() if self.reconstructed is None else self.reconstructed
        self.measured = motion.copy() if self.measured is None else self.measured
        self.table = {
            "status": "done", "window_count": 20, "converged_fraction": 0.95, "max_depth": 60.0, "dac_north": 0.103,
            "dac_east": -0.196, "dac_north_std": 0.05, "dac_east_std": 0.06,
        } | self.table  # fmt: skip

    def write(self, path: Path, index: int) -> None:
        clock = start_of(self.number).astype("int64") / 1e9 + STEP * np.arange(STEPS + 1)
        records = clock[::EVERY]
        write_profile(path, index, "series", {"time": clock, **_named(CHANNELS, self.adjoint), "quality": self.quality})
        write_profile(path, index, "prior", _named(CHANNELS, self.prior))
        write_profile(path, index, "state", {"time": records, **_named(TRACKED, self.reconstructed)})
        write_profile(path, index, "observed", {"time": records, **_named(TRACKED, self.measured)})
        put_table_rows(path, {index: self.table})


def write_archive(path: Path, *contents: Content, spare_samples: int = 50) -> Path:
    """Write an archive, its rows longer than its profiles so that there is filling to trip over."""
    sizes = {"sample": STEPS + 1 + spare_samples, "record": STEPS // EVERY + 6, "window": 3, "segment": 1}
    attributes = {
        "mission": "cost $1 and $2", "platform": {"name": "petrel-l"}, "preset": "recommended", "step": STEP,
        "output_interval": STEP * EVERY,
    }  # fmt: skip
    create_archive(path, [content.number for content in contents], sizes, attributes, overwrite=True)
    for index, content in enumerate(contents):
        content.write(path, index)
    return path


def _named(names, columns):
    return {name: columns[:, i] for i, name in enumerate(names)}


def write_unestimated(path: Path, observations: Path, platform: Platform) -> Path:
    """Write an archive with the measurements of a mission, its vibration and gaps, and no estimate."""
    settings = MissionSettings()
    every = settings.steps_per_record
    with open_observations(observations) as opened:
        series = {number: on_steps(opened.profile(number), settings) for number in opened.profile_numbers}
        first = opened.start_time(opened.profile_numbers[0])
    samples = max(len(one.time) for one in series.values())
    sizes = {"sample": samples, "record": samples // every + 1, "window": 1, "segment": 1}
    attributes = {
        "mission": "not estimated", "platform": platform.model_dump(mode="json"), "step": settings.step,
        "output_interval": settings.output_interval,
    }  # fmt: skip
    create_archive(path, list(series), sizes, attributes, overwrite=True)
    for index, one in enumerate(series.values()):
        clock = epoch_seconds(one.epoch) + one.time
        quality = (1 * vibration_set(platform, one) + 2 * (one.weights == 0.0)).astype(np.uint8)
        write_profile(path, index, "series", {"time": clock, "quality": quality})
        write_profile(path, index, "state", {"time": clock[::every]})
        write_profile(path, index, "observed", {"time": clock[::every], **observed_row(one, every)})
        days = float((one.epoch - first) / np.timedelta64(1, "D"))
        put_table_rows(path, {index: {"status": "done", "elapsed_days": days}})
    return path


MISSION_GROUPS = {group.name for group in MISSION}


def put_profile(path: Path, index: int, group: str, values: dict) -> None:
    """Write a profile's row of a group, with the commit or the digests that go with it."""
    write_profile(path, index, group, values)
    if group in MISSION_GROUPS:
        _commit(path, index, {})
    else:
        _digest_study(path, group)


def put_table_rows(path: Path, rows: dict, group: str = "/") -> None:
    """Write values into a table, the mission's or a study's, with the corresponding commits or digests."""
    write_table_rows(path, rows, group)
    if group == "/":
        for index, row in rows.items():
            _commit(path, index, row)
    else:
        _digest_study(path, group)


def put_whole(path: Path, group: str, values: dict) -> None:
    """Write variables of a study that no profile owns, with their digests."""
    write_whole(path, group, values)
    _digest_study(path, group)


def _digest_study(path: Path, name: str) -> None:
    """Commit the stored values of a study as its results."""
    group, node = study_called(name), zarr.open_group(path, mode="r+", path=name, use_consolidated=False)
    if MANIFEST in node:
        node[MANIFEST][:] = np.full(node[MANIFEST].shape, "", dtype=np.dtypes.StringDType())
        complete_manifests(path, group)
    node.attrs[DIGESTS] = table_digests(path, group)
    consolidate(path)


def _commit(path: Path, index: int, changes: dict) -> None:
    """Commit the stored values of a profile, with some values of its table row changed."""
    store = store_at(path)
    root = zarr.open_group(store, mode="r+", use_consolidated=False)
    before = committed_rows(path).get(index, {})
    row = {name: value for name, value in (before | _plain(changes)).items() if value == value}
    chunks = row_chunks(row_arrays(root, MISSION), index)
    texts = as_texts(row, {}, stored_digests(store, chunks), "2026-01-01T00:00:00Z")
    for name, text in zip(("manifest", "marker"), texts, strict=True):
        root[f"{COMMITS}/{name}"][index : index + 1] = np.array([text], dtype=np.dtypes.StringDType())


def _plain(row: dict) -> dict:
    """Values as JSON holds them: times in seconds since 1970."""
    return {
        name: value.astype("datetime64[ns]").astype("int64") / 1e9
        if isinstance(value, np.datetime64)
        else value.item()
        if isinstance(value, np.generic)
        else value
        for name, value in row.items()
    }
