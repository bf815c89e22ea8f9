"""The commands of `log`: query, follow, export and count entries, from disks of nodes or a database."""
