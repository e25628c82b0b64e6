"""What every part of the engine uses: errors, events, files, the system, words. It uses no other part."""
