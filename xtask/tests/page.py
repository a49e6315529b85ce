"""Opens the page of an experiment in Chromium and looks at it as a user would.

page.py CHROMIUM REPORT.html: table.csv and the recordings are beside the page. Fails with the reason.
"""

import csv
import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import sync_playwright

CHROMIUM, REPORT = sys.argv[1], Path(sys.argv[2]).resolve()
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
]
SIZES = {"wide": (1280, 900), "tablet": (820, 1100), "phone": (390, 844)}


def opened(browser, size, scheme="light"):
    """The page in a window of its own, and what it asks for and complains of."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    requests, complaints = [], []
    page.on("request", lambda request: requests.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.goto(REPORT.as_uri())
    page.wait_for_selector("html[data-painted]", timeout=60_000)
    return page, requests, complaints


def settled(page):
    """Waits for two pictures of the browser."""
    page.evaluate(
        "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
    )


def view(page):
    """The pixels of the 3D view."""
    settled(page)
    image = Image.open(io.BytesIO(page.locator("#view").screenshot()))
    return np.asarray(image.convert("RGB")).astype(int)


def differ(a, b):
    """Share of the pixels that are visibly different, but for the frame of what has the focus."""
    return (np.abs(a - b).max(axis=2) > 24)[6:-6, 6:-6].mean()


def cloth(pixels):
    """Where the cloth's two colours are: much bluer or much yellower than grey."""
    red, blue = pixels[..., 0], pixels[..., 2]
    return np.abs(blue - red) > 40


def recording(clip):
    return np.load(REPORT.parent / clip["solver"] / (clip["case"] + ".npz"))


def check_network_and_console(requests, complaints):
    others = [url for url in requests if url != REPORT.as_uri() and not url.startswith("data:")]
    assert not others, f"the page asks for {others}"
    assert not complaints, f"the console says {complaints}"


def check_table(page):
    with open(REPORT.parent / "table.csv") as file:
        rows = list(csv.DictReader(file))
    table = page.locator("table").first
    heads = [head.strip() for head in table.locator("thead th").all_inner_texts()]
    shown = {}
    for row in table.locator("tbody tr").all():
        cells = [cell.strip() for cell in row.locator("th, td").all_inner_texts()]
        shown[cells[0]] = dict(zip(heads, cells))
        assert row.locator("img").count() == 2, "a picture for each solver"
    for row in rows:
        head = {"published": "Published", "default": "Default"}[row["solver"]]
        cell = shown[row["case"]][head]
        assert cell == f"{float(row['error']):.8f}", f"{row['case']} {head}: {cell}, {row['error']}"
        if row["published_error"]:
            assert float(shown[row["case"]]["Paper"]) == float(row["published_error"])
        support = shown[row["case"]]["Support"].split(":")[1].split()
        assert support == row["support"].split(), support


def check_positions(page):
    """What the page decodes against the recordings: to 0.1 mm, ends whole, held nodes the same."""
    count = page.evaluate("clips.length")
    assert count == 4, count
    for number in range(count):
        clip, times, positions, grasped = page.evaluate(
            """async number => {
                const data = await load(number);
                return [data.clip, ...[data.times, data.positions, data.grasped].map(a => [...a])];
            }""",
            number,
        )
        whole = recording(clip)
        times = np.array(times)
        rows = np.abs(whole["t"][None, :] - times[:, None]).argmin(axis=1)
        assert np.abs(whole["t"][rows] - times).max() < 1e-5
        assert rows[0] == 0 and rows[-1] == len(whole["t"]) - 1
        shape = (len(times), clip["nodes"], 3)
        error = np.linalg.norm(np.reshape(positions, shape) - whole["positions"][rows], axis=2).max()
        assert error <= 1e-4, f"{clip['case']} {clip['solver']}: {error} m"
        assert (np.reshape(grasped, shape[:2]) == whole["grasped"][rows]).all()


def projected(page, points):
    """Where the only view shows points, by the camera's own formula."""
    camera = page.evaluate("camera")
    width, height = page.evaluate("[canvas.clientWidth, canvas.clientHeight]")
    azimuth, elevation = camera["azimuth"], camera["elevation"]
    back = np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    to = points - (np.array(camera["target"]) + camera["distance"] * back)
    scale = 0.5 * min(width, height) / np.tan(0.22)
    depth = -(to @ back)
    return np.stack([width / 2 + scale * (to @ right) / depth, height / 2 - scale * (to @ up) / depth], 1)


def check_player(page):
    page.get_by_label("Compare with").uncheck()
    for name in ["threads", "gripper", "its path"]:
        page.get_by_label(name, exact=True).uncheck()
    page.get_by_role("button", name="Corner").click()
    start = view(page)
    time = page.get_by_label("Time", exact=True)
    assert time.get_attribute("aria-valuetext") == "0.00 seconds"

    # Play moves the cloth, and stops where it is told to
    page.get_by_label("Speed").select_option("4")
    page.get_by_role("button", name="Play", exact=True).click()
    for _ in range(200):
        page.wait_for_timeout(50)
        if float(page.locator("#clock").inner_text().split()[0]) > 4:
            break
    page.get_by_role("button", name="Pause").click()
    moved = view(page)
    assert differ(start, moved) > 0.02, "play moves the cloth"
    settled(page)
    assert differ(moved, view(page)) == 0, "pause stops it"
    assert "held" in page.locator("#state").inner_text()

    # The end is where the recording ends
    time.focus()
    page.keyboard.press("End")
    pixels = view(page)
    assert differ(moved, pixels) > 0.005
    clip = page.evaluate("ready[0].clip")
    points = projected(page, recording(clip)["positions"][-1])
    rows, columns = np.nonzero(cloth(pixels))
    seen = [columns.min(), columns.max() + 1, rows.min(), rows.max() + 1]
    expected = [points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max()]
    assert np.abs(np.subtract(seen, expected)).max() < 3, f"cloth at {seen}, must be {expected}"

    # Keys
    page.locator("#view").focus()
    for key in ["ArrowLeft", "ArrowUp", "+", "Shift+ArrowRight"]:
        before = view(page)
        page.keyboard.press(key)
        assert differ(before, view(page)) > 0.002, f"{key} moves the view"
    page.keyboard.press("Home")
    assert differ(view(page), pixels) == 0, "Home returns"
    page.keyboard.press(",")
    assert page.evaluate("state.time < end()"), "a step back"
    page.keyboard.press(" ")
    assert page.evaluate("state.playing"), "space plays"
    page.keyboard.press(" ")

    # Colours, ghost and the other switches
    for colour in ["strain", "height", "layer"]:
        page.get_by_label("Colour").select_option(colour)
        assert page.locator("#legend-words span").count() >= 2
        assert differ(view(page), pixels) > 0.02, f"coloured by {colour}"
    page.get_by_label("Colour").select_option("side")
    assert page.locator("#legend").is_hidden()
    for name in ["ideal fold", "threads", "gripper", "its path"]:
        before = view(page)
        page.get_by_label(name, exact=True).check()
        assert differ(before, view(page)) > 0.0002, name

    # A case from the table, both solvers beside each other
    page.get_by_role("button", name="C4", exact=True).click()
    settled(page)
    assert page.evaluate("ready.map(data => data.clip.case + ' ' + data.clip.solver)") == [
        "C4 published",
        "C4 default",
    ]
    page.get_by_role("button", name="Pause").click()
    halves = cloth(view(page))
    middle = halves.shape[1] // 2
    assert halves[:, :middle].mean() > 0.02 and halves[:, middle:].mean() > 0.02


def check_curves(page):
    chart = page.locator("#chart svg")
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + box["width"] - 20, box["y"] + 100)
    values = [float(text) for text in page.locator(".readout b").all_inner_texts()]
    with open(REPORT.parent / "curves.csv") as file:
        rows = list(csv.reader(file))
    near = [float(value) for value in rows[-5][1:]]
    assert len(values) == len(near)
    assert np.allclose(sorted(values), sorted(near), rtol=0.05, atol=1e-6), f"{values}, {near}"
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 100)
    assert 4 < page.evaluate("state.time") < 7, "a click moves the player"


def check_names(page):
    """Every control has a name for those who cannot see it."""
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("input, select, button, canvas, img, svg[role=img]")]
            .filter(e => !(e.labels?.length || e.getAttribute("aria-label") || e.alt || e.textContent.trim()))
            .map(e => e.outerHTML.slice(0, 80))"""
    )
    assert not nameless, nameless


with sync_playwright() as playwright:
    browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
    page, requests, complaints = opened(browser, SIZES["wide"])
    check_table(page)
    check_positions(page)
    check_player(page)
    check_curves(page)
    check_names(page)
    first = view(page)
    for name, size in SIZES.items():
        page.set_viewport_size({"width": size[0], "height": size[1]})
        settled(page)
        wide, inner = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
        assert wide <= inner, f"{name}: the page is {wide} pixels wide in a window of {inner}"
        assert page.evaluate("canvas.width === canvas.clientWidth"), f"{name}: the view is resized"
        assert cloth(view(page)).mean() > 0.02, f"{name}: the cloth is seen"
    page.set_viewport_size({"width": SIZES["wide"][0], "height": SIZES["wide"][1]})
    page.emulate_media(color_scheme="dark")
    assert view(page)[5, -5].max() < 80, "dark when the system is"
    check_network_and_console(requests, complaints)
    browser.close()
print("the page is as it should be")
