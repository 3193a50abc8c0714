"""The spacecraft: one run of it with all that a simulation needs, as frozen records in SI units."""
