"""The studio: a server for a page in the browser, on which a character is set up, played, recorded and exported."""
