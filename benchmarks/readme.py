"""Section of the README on performance, rendered from the results so that no figure is typed by hand."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks.engines import REFERENCE
from benchmarks.results import SMOOTHER_PEERS
from benchmarks.sections import with_section
from gliderhpc.findings.formatting import markdown

README = Path(__file__).resolve().parents[1] / "README.md"
SECTION = "performance"

BUSY = 0.5
"""Load of other work above which the section warns of it."""


PAPERS_CORE_HOURS = 250
"""26.6 minutes of one core a dive (the paper's Table 2), 565 dives."""


def performance_section(results: Mapping[str, Any]) -> str:
    """Render the text between the marks."""
    lines = [_machine(results["machine"]), ""]
    if "window" in results:
        lines += [_windows(results), "", *_sentences(results), ""]
    if results.get("missions"):
        lines += [_missions(results["missions"]), ""]
    return "\n".join(lines).strip()


def update_readme(results: Mapping[str, Any], path: Path = README) -> None:
    """Write the section into the README."""
    path.write_text(with_section(path.read_text("utf-8"), SECTION, performance_section(results)), "utf-8")


def _machine(machine: Mapping[str, Any]) -> str:
    versions = ", ".join(f"{name} {machine[name]}" for name in ("python", "numba", "numpy", "scipy"))
    line = f"Measured on {machine['day']} by `make bench`: {machine['cpu']}, {machine['cores']} cores, {versions}."
    if machine["load"] > BUSY:
        line += f" The machine was busy with other work (load {machine['load']:.1f}): prefer ratios to times."
    return line


def _windows(results: Mapping[str, Any]) -> str:
    gradients, windows = results["gradient"]["paper"], results["window"]["paper"]
    order = sorted(windows, key=lambda name: windows[name]["median"])
    rows = [
        [
            results["contenders"][name]["label"],
            _milliseconds(gradients[name]["median"]),
            f"{_milliseconds(windows[name]['median'])} ({_milliseconds(windows[name]['lower'])} to "
            f"{_milliseconds(windows[name]['upper'])})",
            f"{windows[name]['ratio']:.2g}" if windows[name]["ratio"] < 10 else f"{windows[name]['ratio']:.0f}",
            f"{windows[name]['iterations']:g}",
            _converged(windows[name]),
        ]
        for name in order
    ]
    engine = results["contenders"][REFERENCE]["label"]
    headings = (
        "one core, 300-step windows, preset `paper`",
        "cost and gradient, ms",
        "whole window, ms (quartiles)",
        f"time relative to {engine.removeprefix('gliderhpc, ')} (means)",
        "iterations",
        "converged",
    )
    return markdown(headings, rows)


def _sentences(results: Mapping[str, Any]) -> Iterable[str]:
    yield "All peers solve the same windows. Their cost and gradient were first compared with this project's (largest relative"
    worst = max(row["largest_relative_difference"] for row in results["contenders"].values())
    yield f"difference {worst:.0e}), and their solutions are judged by the same optimality measure:"
    yield f"{_tools(results['contenders'])}."
    yield "Settings and tuning are in `benchmarks/results.json`, reasons in `benchmarks/peers/`."
    for name, lack in results["skipped"].items():
        yield f"Not measured here: {name} ({lack})."
    yield ""
    peak = results["peak_flops"]
    for name, share in results["fraction_of_peak"].items():
        yield (
            f"- Engine {name}: {results['operations_a_gradient'] / 1e6:.2f} Mflop per gradient, {share:.1%} of the "
            f"{peak / 1e9:.0f} GFLOP/s that one core was measured to reach."
        )
    for preset, entries in results["profile"].items():
        times = ", ".join(f"{row['median']:.2f} s with engine {name}" for name, row in entries.items())
        yield f"- A whole profile of {results['profile_minutes']:.0f} minutes, preset `{preset}`: {times}."
    yield _smoother(results["smoother"])
    for name, row in results["duration"].items():
        low, high = row["minutes"][0], row["minutes"][-1]
        yield (
            f"- Cost grows as duration to the power {row['exponent']:.2f} (profiles of {low:.0f} to {high:.0f} minutes, "
            f"engine {name})."
        )
    for name, rows in results["workers"].items():
        last = rows[-1]
        memory = max(row["peak_worker_mib"] for row in rows)
        yield (
            f"- {last['workers']} workers are {last['speedup']:.2f} times as fast as one; a worker used at most "
            f"{memory:.0f} MiB (engine {name})."
        )


def _smoother(row: Mapping[str, Any]) -> str:
    ratios, differences = row["ratios"], row["largest_differences"]
    peers = ", ".join(f"{SMOOTHER_PEERS[name]} {ratio:.1f} times as long" for name, ratio in ratios.items())
    apart = ", ".join(f"{differences[name]:.0e}" for name in ratios)
    return (
        f"- The smoother took {row['pass_us']:.1f} μs per step and pass on {row['day']} (forwards {row['forward_us']['median']:.1f}, "
        f"backwards {row['backward_us']['median']:.1f}), linearisation and mean shift included, and {row['whole_us']['median']:.0f} μs per "
        f"step for a whole dive of {row['minutes']:.0f} minutes from the filter's estimate. A pass of other implementations over the "
        f"same segments, without the linearisation, takes longer: {peers} (largest differences of means in deviations and "
        f"of relative variances: {apart})."
    )


def _missions(missions: Mapping[str, Mapping[str, Any]]) -> str:
    rows = [
        [
            f"{row['profiles']} profiles, {row['record_hours']:.0f} h of record, `{row['preset']}`, engine {row['engine']}",
            f"{row['wall_seconds'] / 60.0:.1f}",
            f"{row['workers']}",
            f"{row['core_hours']:.2f}",
            f"{row['peak_worker_mib']:.0f}",
            f"{row['archive_mib']:.0f}",
            f"{row['failed']}",
            f"{row['machine']['cpu']}, {row['machine']['cores']} cores",
        ]
        for row in missions.values()
    ]
    headings = (
        "whole mission", "minutes", "workers", "core-hours", "peak of a worker, MiB", "archive, MiB", "failed", "machine",
    )  # fmt: skip
    return (
        markdown(headings, rows) + f"\n\nThe paper's own pipeline: {PAPERS_CORE_HOURS} core-hours for its 565 profiles."
    )


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}"


def _converged(row: Mapping[str, Any]) -> str:
    return f"{row['outcomes'].get('converged', 0)} of {sum(row['outcomes'].values())}"


def _tools(contenders: Mapping[str, Mapping[str, Any]]) -> str:
    versions = {tool: version for row in contenders.values() for tool, version in row["versions"].items()}
    return ", ".join(f"{tool} {version}" for tool, version in versions.items() if tool != "gliderhpc")
