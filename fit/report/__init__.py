"""The report: one page from telemetry and results, its tables, and what notebooks show."""
