"""Running: campaigns on processes or a cluster, into telemetry files that survive."""
