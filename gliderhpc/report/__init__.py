"""Reports: figures and tables of profiles, missions and studies, and the page that shows them.

The package itself can be called: ``gliderhpc.report("m12.zarr", "out")`` calls
`gliderhpc.report.page.report.write_report`. A function of that name in `gliderhpc` would be replaced by this package at
the first import of one of its modules.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gliderhpc.report.page.rendering import ReportFiles
    from gliderhpc.store_schema.location import Location


class _Report(ModuleType):
    """Package that can be called to write a report."""

    def __call__(
        self,
        store: "Location | Sequence[Location]",
        out: str | Path,
        *,
        profile: int | None = None,
        twins: str | Path | None = None,
        truth: str | Path | None = None,
    ) -> "ReportFiles":
        """Write one or several archives as HTML pages; parameters as in `gliderhpc.report.page.report.write_report`."""
        from gliderhpc.report.page.report import write_report

        return write_report(store, out, profile=profile, twins=twins, truth=truth)


sys.modules[__name__].__class__ = _Report
