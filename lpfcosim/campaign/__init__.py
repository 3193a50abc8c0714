"""Campaigns: the TOML file, checked, as the runs that are to be simulated."""
