"""Strict readers and exact writers, one module for each mesh format; :mod:`dmp.meshio` is their front.

The readers use NumPy and the standard library alone. They check every declared count against the bytes that are there
before anything is allocated, open no other file, and raise :class:`dmp.formats.source.FormatError` with the line or
byte of the damage.
"""
