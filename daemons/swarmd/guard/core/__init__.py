"""Decisions of the guard: when a service is started, killed, restarted or given up. No process, no clock."""
