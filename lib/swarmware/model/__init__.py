"""The data model: names and paths, resources and templates, frames, clocks, documents.

Only values and rules: nothing here waits, sends, or maps memory.
"""
