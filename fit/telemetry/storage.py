"""How a dataset of HDF5 is stored: in the file, written whole, and through filters that are safe."""

import math

import h5py

from fit.errors import StorageError

MAX_CHUNK = 2**24  # values that are unpacked at a time
#: What may stand between a chunk and the file: these are safe with whatever they are given.
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF}


def check_storage(dataset: h5py.Dataset, place: str) -> None:
    """Refuse a dataset that is kept in other files, or whose values take far more room than the file.

    What was left out reads as zeros, and a few bytes that stand for a chunk can stand for gigabytes.

    Raises
    ------
    StorageError
        If it is.
    """
    if dataset.is_virtual or dataset.external:
        raise StorageError(place, "kept in other files", "its values in this one")
    size = dataset.size or 0
    stored_bytes = dataset.id.get_storage_size()
    if stored_bytes > dataset.file.id.get_filesize():
        raise StorageError(place, f"declares {stored_bytes} bytes, more than the file has", "a whole file")
    properties = dataset.id.get_create_plist()
    filters = [properties.get_filter(i)[0] for i in range(properties.get_nfilters())]
    if dataset.chunks is None:
        written = stored_bytes // dataset.dtype.itemsize
    else:
        chunk = math.prod(dataset.chunks)
        if chunk > MAX_CHUNK or len(set(filters)) < len(filters) or not _FILTERS.issuperset(filters):
            raise StorageError(
                place,
                f"chunks of {chunk} values through the filters {filters}",
                f"at most {MAX_CHUNK} through each of gzip, lzf, shuffle and fletcher32 at most once",
                is_filtered=True,
            )
        written = dataset.id.get_num_chunks() * chunk
    if written < size:
        extent = f"only {written} values of {size}" if written else "never"
        raise StorageError(place, f"declared but {extent} written", f"{size} values")
