"""Requests of operators and applications: values of resources, lists of them, changes, configuration."""
