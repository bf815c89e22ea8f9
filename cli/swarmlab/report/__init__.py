"""The report of an experiment: computed from the recordings and the run's metadata, drawn, written as a page.

Needs no running process: `lab report` computes it again from the files of an earlier run.
"""
