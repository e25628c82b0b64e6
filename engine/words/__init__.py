"""Words that a prompt may name: those of the offline vocabulary, and prompts of several objects as people type them.

Standard library only: Blender and the server split prompts as the engine does.
"""

from .splitting import join_texts, split_texts
from .word_list import normalised, similarly_spelt, word_list

__all__ = ["join_texts", "normalised", "similarly_spelt", "split_texts", "word_list"]
