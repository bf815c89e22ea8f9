"""What nodes exchange and read: names and paths, resources and templates, frames, clocks, documents.

Values and rules only: nothing here waits, sends, or maps memory.
"""
