"""Limits, common types and the base of all requests."""

from typing import Annotated

from pydantic import Field, FiniteFloat

from puppetline.toml_schema import Table

MAX_REQUEST_BYTES = 1_000_000
"""Maximum size of a request in bytes. The largest is `Edit`; 64 limbs take about 50,000 bytes."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
"""Name of a character, stage or take."""

Id = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]
"""Id of an upload, a file or a job."""

Seconds = Annotated[FiniteFloat, Field(ge=0, le=86_400)]


class Request(Table):
    """A request; all requests have the keys `id` and `do`."""

    id: int
