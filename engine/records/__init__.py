"""What a curator writes about an object in, its record on disk and in exported files out."""

from .museum_record import MuseumRecord, load_record, save_record

__all__ = ["MuseumRecord", "load_record", "save_record"]
