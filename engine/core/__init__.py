"""Small modules that every part of the engine uses: errors, events, files, the system, words. They use nothing of ours."""
