"""Words that a prompt may name: those of the offline vocabulary, and prompts of several objects as people type them.

Standard library only: Blender and the server split prompts as the engine does.
"""

from .alike import likeness
from .splitting import join_texts, split_list, split_texts
from .vocabulary_words import MADE_CLASSES, normalised, picture_words, pictured, similarly_spelt, singulars, word_list
