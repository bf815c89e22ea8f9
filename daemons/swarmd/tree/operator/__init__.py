"""Requests of operators and applications: values, lists, changes, configuration."""
