"""The way from photos to objects: the plan, the stages in order, and how each is run, skipped or continued."""
