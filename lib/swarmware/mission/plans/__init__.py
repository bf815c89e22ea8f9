"""Plans of other tools: reading their files, and converting them to missions.

Belongs here: file formats of ground stations, and the conversion table. Not here: reading from a disk, the
map's projection, which the caller passes.
"""
