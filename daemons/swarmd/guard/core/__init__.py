"""Decisions of the guard: when a service is started, killed, restarted or given up; no process or clock."""
