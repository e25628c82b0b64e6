"""The files of a project: its folder, versions, content, objects with their records, and how each was made."""
