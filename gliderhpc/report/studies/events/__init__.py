"""Figure and captions of study ``events``."""
