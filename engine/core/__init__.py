"""Parts that every other part of the engine uses: errors, events, files, the system, words. They use no other part."""
