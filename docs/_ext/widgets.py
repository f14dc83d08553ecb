"""Widgets in the handbook: drawn as they were when their notebook ended, without a kernel.

The page holds all that is needed. What notebooks show otherwise loads programs from the web.
"""

from __future__ import annotations

import base64
import json
from typing import Any

VIEW = "application/vnd.jupyter.widget-view+json"
STATE = "application/vnd.jupyter.widget-state+json"
PAGE = """\
<div class="dobc-still">
<style>%(css)s</style>
<div inert id="%(name)s"></div>
<p><em>As it is when the last cell has run. In Jupyter it can be changed.</em></p>
<script type="module">
const values = %(values)s;
const nothing = () => {};
const model = { get: (key) => values[key], set: nothing, on: nothing, off: nothing, send: nothing,
  save_changes: nothing };
const { default: widget } = await import("data:text/javascript;base64,%(program)s");
widget.render({ model, el: document.getElementById("%(name)s") });
</script>
</div>"""


def drawn(state: dict[str, Any], name: str) -> str:
    """HTML that draws one widget of anywidget's kind; ``name`` is an id on its page."""
    values = {key: value for key, value in state.items() if not key.startswith("_")}
    return PAGE % {
        "css": state["_css"],
        "name": name,
        "values": json.dumps(values).replace("</", "<\\/"),
        "program": base64.b64encode(state["_esm"].encode()).decode(),
    }


def stilled(text: str) -> str:
    """The notebook with a drawing in place of every widget."""
    notebook = json.loads(text)
    kept = notebook["metadata"].pop("widgets", {}).get(STATE, {}).get("state", {})
    for cell in notebook["cells"]:
        for output in cell.get("outputs", []):
            view = output.get("data", {}).get(VIEW)
            if view is None:
                continue
            name = view["model_id"]
            output["data"] = {"text/html": drawn(kept[name]["state"], f"widget-{name}")}
    return json.dumps(notebook, indent=1, ensure_ascii=False) + "\n"
