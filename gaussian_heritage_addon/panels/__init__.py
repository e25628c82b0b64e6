"""The panels of the sidebar and the page of the preferences."""
