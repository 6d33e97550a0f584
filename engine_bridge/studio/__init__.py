"""The studio: a server for a page in the browser, on which characters are set up, driven, recorded and exported."""
