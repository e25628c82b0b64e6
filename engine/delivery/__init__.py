"""Files that leave a project: museum records, packages to keep, and the report."""
