"""Study ``spectra``: the fast part of a disturbance and the power law that its spectrum follows (section 5.3)."""

from gliderhpc.studies.spectra.study import STUDY

__all__ = ["STUDY"]
