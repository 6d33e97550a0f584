"""The wire protocol: header, payloads and scene, as bytes."""
