"""Messages that a watch wrote earlier, which may be damaged or of an earlier version of this program."""

import logging
from pathlib import Path

from gliderhpc.api.watch_state import ReportedDive
from gliderhpc.report.surfacing_message import SurfacingMessage

log = logging.getLogger("gliderhpc.watch")


def knew_current(dive: ReportedDive, folder: Path) -> bool:
    """Return whether a dive was reported with its current; one whose message cannot be read counts as such."""
    if dive.current_known is not None:
        return dive.current_known
    try:
        message = SurfacingMessage.model_validate_json((folder / dive.file).read_text("utf-8"))
    except (OSError, ValueError):
        return True
    return message.current is not None


def changes_since(message: SurfacingMessage, path: Path) -> tuple[str, ...]:
    """List the differences from the earlier message in a file; none, with a warning, if that cannot be read."""
    if not path.exists():
        return ()
    try:
        return message.changes_since(path.read_text("utf-8"))
    except ValueError:  # Not UTF-8, not JSON, or not such a message.
        log.warning("%s: is not a readable message, so what changed since then is not reported; it is replaced", path)
        return ()
