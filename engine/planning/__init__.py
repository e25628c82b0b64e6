"""Photos, machine and wishes come in; a plan goes out: what is done, what is left out and why, how long, how large."""

__all__: list[str] = []
