"""Study ``reanalysis``: the depth-averaged current and ocean models (section 5.5, Table 4, Figure 8)."""

from gliderhpc.studies.reanalysis.study import STUDY

__all__ = ["STUDY"]
