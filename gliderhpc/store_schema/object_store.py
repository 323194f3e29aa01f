"""Archives in an object store, by zarr's own store over obstore (extra ``cloud``)."""

from __future__ import annotations

from typing import Any

from zarr.abc.store import Store
from zarr.storage import ObjectStore

from gliderhpc.errors import InputError


def object_store_at(address: str, *, read_only: bool = False) -> Store:
    """Open the store of an address such as ``s3://bucket/mission.zarr``.

    Keys, region and endpoint come from the environment by the usual names (``AWS_ACCESS_KEY_ID``,
    ``AWS_SECRET_ACCESS_KEY``, ``AWS_REGION``, ``AWS_ENDPOINT_URL``, ``AWS_ALLOW_HTTP``).

    Raises
    ------
    InputError
        obstore is not installed, or the address is none that it knows.
    """
    return ObjectStore(bucket_at(address), read_only=read_only)


def bucket_at(address: str) -> Any:
    """Open obstore's own store of an address, everything below it.

    Raises
    ------
    InputError
        obstore is not installed, or the address is none that it knows.
    """
    try:
        from obstore.exceptions import BaseError
        from obstore.store import from_url
    except ImportError:
        raise InputError(f"{address}: object stores need obstore; install gliderhpc[cloud]") from None
    try:
        return from_url(address)
    except (BaseError, ValueError) as error:
        raise InputError(f"{address}: cannot be opened ({str(error).splitlines()[0]})") from None
