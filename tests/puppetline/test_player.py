import base64
import re

import puppetline as pl
from puppetline.player import Player


def test_the_page_contains_the_file_and_its_title_is_text(blob_file):
    page = Player(blob_file.read_bytes(), "<b>Rex</b>").page()
    (glb,) = re.findall('id="glb">([^<]*)<', page)
    assert base64.b64decode(glb) == blob_file.read_bytes()
    assert "<b>" not in page.split("<script>")[0]


def test_a_notebook_shows_a_character_that_moves_and_asks_for_nothing_else(browser, limbed_puppet, take):
    cell = pl.load(limbed_puppet).show(take)._repr_html_()
    page = browser.new_page(viewport={"width": 400, "height": 420})
    requests, errors = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("pageerror", lambda error: errors.append(error))  # Playwright sets attributes of it
    page.set_content(cell)
    seen = set()
    while len(seen) < 4:  # the character moves
        seen.add(page.screenshot())
    assert errors == []
    assert [url for url in requests if not url.startswith(("about:", "data:", "blob:"))] == []
    page.close()
