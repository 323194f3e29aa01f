"""Figure of study ``intermittency``."""
