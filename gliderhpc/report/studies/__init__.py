"""Figures, tables and captions of the studies: functions of what an archive holds and of nothing else."""
