"""Museum records: what a curator enters about an object, on disk and in exported files."""

from .museum_record import MuseumRecord, load_record, save_record

__all__ = ["MuseumRecord", "load_record", "save_record"]
