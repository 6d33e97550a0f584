"""The service that the studio starts or joins."""
