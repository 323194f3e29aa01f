"""Reports: figures and tables of profiles, missions and studies, and the page that shows them.

The package itself can be called: ``gliderhpc.report("m12.zarr", "out")`` is `gliderhpc.report.page.write_report`. A
function of that name in `gliderhpc` would be replaced by this package as soon as one of its modules is imported.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from gliderhpc.wording import speaks_python

if TYPE_CHECKING:
    from gliderhpc.report.page import Written
    from gliderhpc.store_schema.place import Place


class _Report(ModuleType):
    """The package as a callable, which writes a report."""

    @speaks_python
    def __call__(
        self,
        store: "Place | Sequence[Place]",
        out: str | Path,
        *,
        profile: int | None = None,
        twins: str | Path | None = None,
        truth: str | Path | None = None,
    ) -> "Written":
        """Write one or several archives as pages of HTML; parameters as of `gliderhpc.report.page.write_report`."""
        from gliderhpc.report.page import write_report

        return write_report(store, out, profile=profile, twins=twins, truth=truth)


sys.modules[__name__].__class__ = _Report
