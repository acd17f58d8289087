"""The commands of ``dmp …``, by what they are about; :mod:`dmp.cli` gathers them."""
