"""The page on which a kiosk's visitor types a code, and plays and saves the video."""

from html import escape

PAGE = """<!doctype html>
<html lang="en">
  <meta charset="utf-8">
  <meta name="viewport" content="width=device-width, initial-scale=1">
  <title>Your film</title>
  <link rel="icon" href="data:,">
  <link rel="stylesheet" href="/clips.css">
  <h1>Your film</h1>
  {body}
  <form action="/clips">
    <label for="code">Type your code</label>
    <input id="code" name="code" value="{code}" maxlength="12" autocomplete="off" autocapitalize="characters" required>
    <button>Show my film</button>
  </form>
</html>
"""

STYLE = """:root { color-scheme: light dark; font: 1.25rem/1.4 system-ui, sans-serif; }
body { margin: 0 auto; padding: 1.5rem; max-width: 40rem; }
form, video { display: grid; gap: 0.75rem; width: 100%; }
input, button, a {
  box-sizing: border-box; width: 100%; padding: 0.75rem; border: 2px solid; border-radius: 0.75rem;
  font: inherit; font-size: 1.5rem; text-align: center;
}
input { letter-spacing: 0.3em; text-transform: uppercase; }
button, a { display: block; margin: 1rem 0; border-color: #14532d; background: #14532d; color: #fff; font-weight: 600; }
"""


def clip_page(code: str, found: bool) -> str:
    """Return the page: empty, with the video of a code, or with the reason why there is none."""
    if found:
        body = (
            f'<video src="/clips/{code}" controls autoplay playsinline></video>\n'
            f'  <a href="/clips/{code}" download="film-{code}.mp4">Save my film</a>'
        )
    elif code:
        body = (
            "<p role=alert>There is no film for this code. Check the letters. A film is kept for some minutes only.</p>"
        )
    else:
        body = ""
    return PAGE.format(body=body, code=escape(code))
