"""``twin recoverability``: what can be found at all, and the budget of the current."""
