"""File of results, and its table on the terminal."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

RESULTS = Path(__file__).with_name("results.json")
QUICK = Path(__file__).with_name("quick.json")
"""File of a first look, so that it never replaces the published figures."""

Results = dict[str, Any]


def read_results(path: Path) -> Results:
    """Read results; none where there is no such file."""
    return dict(json.loads(path.read_text("utf-8"))) if path.exists() else {}


def write_results(path: Path, results: Mapping[str, Any]) -> None:
    """Write results, keys in order of insertion, so that a change shows as one."""
    path.write_text(json.dumps(results, indent=2) + "\n", "utf-8")


SMOOTHER_PEERS = {"dense": "whole matrices in NumPy", "dynamax": "dynamax on JAX"}
"""Peers of the smoother's pass, by their names in the results."""


def terminal_table(results: Results) -> Table:
    """One table: every engine and peer, then profiles, scaling, memory and peak."""
    machine = results["machine"]
    title = f"{machine['cpu']}, {machine['cores']} cores, other work's load {machine['load']:.1f}"
    table = Table(title=title, title_justify="left")
    for heading in ("", "median", "quartiles", "times the reference", "remarks"):
        table.add_column(heading, justify="left" if heading in ("", "remarks") else "right", no_wrap=heading == "")
    for what, rows in (("gradient", results["gradient"]), ("window", results["window"])):
        for preset, entries in rows.items():
            for name, row in entries.items():
                label = results["contenders"][name]["label"]
                table.add_row(f"{what}, {preset}: {label}", *_cells(row), f"{row['ratio']:.2f}", _worth(row))
    for preset, entries in results["profile"].items():
        for name, row in entries.items():
            label = results["contenders"][name]["label"]
            table.add_row(f"profile of {results['profile_minutes']:.0f} min, {preset}: {label}", *_cells(row), "", "")
    row = results["smoother"]
    table.add_row("smoother", f"{row['pass_us']:.2f} us a step", "", "", "one pass")
    for name, ratio in row["ratios"].items():
        remark = f"{ratio:.1f} times as long as ours"
        table.add_row(
            f"smoother: {SMOOTHER_PEERS[name]}", f"{row[f'{name}_us']['median']:.2f} us a step", "", "", remark
        )
    for name, row in results["duration"].items():
        table.add_row(f"growth with duration: {name}", f"exponent {row['exponent']:.2f}", "", "", "1: in proportion")
    for name, rows in results["workers"].items():
        for row in rows:
            remark = f"speed-up {row['speedup']:.2f}, at most {row['peak_worker_mib']:.0f} MiB per worker"
            table.add_row(
                f"{row['profiles']} profiles, {row['workers']} workers: {name}",
                f"{row['seconds']:.1f} s",
                "",
                "",
                remark,
            )
    table.add_row("FMA peak of one core", f"{results['peak_flops'] / 1e9:.1f} GFLOP/s", "", "", _fractions(results))
    for name, lack in (results["skipped"] | results["smoother"]["skipped"]).items():
        table.add_row(f"{name} skipped", "", "", "", lack)
    return table


def _cells(row: Mapping[str, Any]) -> tuple[str, str]:
    return f"{1e3 * row['median']:.3f} ms", f"{1e3 * row['lower']:.3f} to {1e3 * row['upper']:.3f}"


def _worth(row: Mapping[str, Any]) -> str:
    if "outcomes" not in row:
        return ""
    outcomes = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in row["outcomes"].items())
    return f"{row['iterations']:g} iterations, {outcomes}, cost {row['cost']:.4g}"


def _fractions(results: Results) -> str:
    shares = [f"{name} {share:.0%}" for name, share in results["fraction_of_peak"].items()]
    return f"{results['operations_a_gradient'] / 1e6:.2f} Mflop per gradient: " + ", ".join(shares)
