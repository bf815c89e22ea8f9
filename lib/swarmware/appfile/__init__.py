"""The application files of a node: who runs here, what each provides, answers and reads (ADR 1).

A locked file per application: the kernel takes the lock back when its holder dies, so no server is needed to
know who lives.
"""

from swarmware.appfile.entry import AppEntry, Served
from swarmware.appfile.file import AppFile
from swarmware.appfile.table import AppTable, scan

__all__ = ["AppEntry", "AppFile", "AppTable", "Served", "scan"]
