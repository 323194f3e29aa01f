"""Change points as the archive's group ``drift`` keeps them."""

from typing import Any

import numpy as np
import xarray as xr

from gliderhpc.studies.drift.change_points import PARTS, QUANTITIES, Change, Changes, Size, SizeKey
from gliderhpc.studies.drift.medians import PRIMARY
from gliderhpc.studies.provenance import kept

_GROUP, _KIND = "drift", "change_kind"
_AND = " and "
_ENDS = ("", "_low", "_high")
_MISSING = float("nan")


def changes_to_keep(changes: Changes) -> dict[str, Any]:
    """Variables of the group, an entry a change; empty where there is none."""
    rows = [_row(one) for one in changes.found]
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def kept_changes(archive: xr.DataTree) -> Changes:
    """Read the change points that an archive's group keeps.

    Raises
    ------
    InputError
        The study was left by a version of this program that looked for none.
    """
    p = kept(archive, _GROUP, "p_of_next_change")
    group = archive[_GROUP].to_dataset()
    found = [_change(group.isel(change=place)) for place in range(group.sizes["change"])]
    return Changes(tuple(one for one in found if one is not None), _MISSING if p is None else float(p))


def _row(change: Change) -> dict[str, Any]:
    sizes = {
        f"{_name(key)}{end}": getattr(change.sizes.get(key, Size(*[_MISSING] * 3)), field)
        for key in _keys()
        for end, field in zip(_ENDS, ("value", "low", "high"), strict=True)
    }
    return {
        _KIND: change.kind, "change_form": change.form, "change_phases": _AND.join(change.phases),
        "change_estimates": _AND.join(change.estimates), "first_profile": float(change.first),
        "last_profile": float(change.last), "back_profile": _MISSING if change.back is None else float(change.back),
        "first_day": change.days[0], "last_day": change.days[1], "back_day": change.back_day, "change_p": change.p,
        "change_mean": change.mean, **sizes,
    }  # fmt: skip


def _change(entry: xr.Dataset) -> Change | None:
    def number(name: str) -> float:
        return float(entry[name].values)

    kind = str(entry[_KIND].values)
    if not kind or not np.isfinite(number("first_profile")):
        return None
    back = number("back_profile")
    sizes = {key: Size(*(number(f"{_name(key)}{end}") for end in _ENDS)) for key in _keys()}
    return Change(
        kind, str(entry["change_form"].values), tuple(str(entry["change_phases"].values).split(_AND)),
        tuple(str(entry["change_estimates"].values).split(_AND)), int(number("first_profile")),
        int(number("last_profile")), int(back) if np.isfinite(back) else None,
        (number("first_day"), number("last_day")), number("back_day"), number("change_p"), number("change_mean"),
        {key: size for key, size in sizes.items() if np.isfinite(size.value)},
    )  # fmt: skip


def _keys() -> list[SizeKey]:
    return [(quantity, part, estimate) for quantity in QUANTITIES for part in PARTS for estimate in PRIMARY]


def _name(key: SizeKey) -> str:
    quantity, part, estimate = key
    return f"{quantity}_change_{part}_{estimate}"
