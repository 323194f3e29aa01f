"""The hull during a mission: its errors from the information of all dives, and their changes from dive to dive."""
