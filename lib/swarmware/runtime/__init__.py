"""Execution of sans-io cores: their contract, their driver, the report of slow steps.

Not here: decisions, and any input or output but waiting for a deadline.
"""
