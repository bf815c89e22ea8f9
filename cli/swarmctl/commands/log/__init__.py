"""The record: query, follow, export, count."""
