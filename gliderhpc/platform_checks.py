"""Checks of a platform file that concern several numbers at once: masses, moments of inertia, keys of uncertainties."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gliderhpc.platform_sections import Section, has_number
from gliderhpc.shipped import nearest

if TYPE_CHECKING:
    from gliderhpc.platform import Platform

ROUNDED_MASSES = 1.01
"""Largest ratio of the parts' mass to the total that rounding can cause."""

ROUNDED_MOMENTS = 1.1
"""Largest ratio of a moment of inertia to the sum of the other two that rounding to two digits can cause: a slender
hull has 12 kg m2 in pitch if it has 0.6 in roll and 11 in yaw."""


def check_together(platform: Platform) -> None:
    """Refuse numbers that are valid one by one, but that no hull has together.

    Raises
    ------
    ValueError
        There are such numbers; the message names the key and the rule.
    """
    _check_masses(platform)
    _check_inertia(platform)
    _check_uncertain_keys(platform)


def _check_masses(platform: Platform) -> None:
    """Refuse parts heavier than the whole; they need not add up to the total, which includes the oil."""
    mass = platform.mass
    if mass.hull + mass.battery > ROUNDED_MASSES * mass.total:
        raise ValueError(
            f"mass.total is {mass.total:g} (total mass m, kg): it must be at least that of mass.hull and mass.battery "
            f"together, {mass.hull + mass.battery:g}; correct the masses"
        )


def _check_inertia(platform: Platform) -> None:
    """Refuse a moment of inertia greater than the sum of the other two, which no body has."""
    moments = platform.inertia
    greatest = max(moments)
    others = sum(moments) - greatest
    if greatest > ROUNDED_MOMENTS * others:
        raise ValueError(
            f"inertia is [{', '.join(f'{moment:g}' for moment in moments)}] (rigid-body inertia J_x, J_y, J_z, kg m2): "
            f"each must be at most the sum of the other two, as in every body, but {greatest:g} is more than "
            f"{others:g}; correct the values"
        )


def _check_uncertain_keys(platform: Platform) -> None:
    for entry, keys in ({} if platform.uncertainty is None else platform.uncertainty.keys).items():
        for key in keys:
            if not has_number(platform, key):
                known = nearest(key, _number_keys(platform))
                raise ValueError(f"there is no number '{key}', which uncertainty.{entry} names{known}; correct the key")


def _number_keys(node: Any, key: str = "") -> Iterator[str]:
    """Yield the dotted keys of all single numbers of a section, with those of lists: ``position.hull.2``."""
    if isinstance(node, Section):
        parts = {name: getattr(node, name) for name in type(node).model_fields if name != "uncertainty"}
    elif isinstance(node, tuple):
        parts = {str(index): value for index, value in enumerate(node)}
    elif node is None or isinstance(node, float | int):
        yield key
        return
    else:
        return
    for name, value in parts.items():
        yield from _number_keys(value, f"{key}.{name}".removeprefix("."))
