# %% [markdown]
# # Tiles in a notebook
# Jupyter (by jupytext), VS Code and Spyder open this file as a notebook: each `# %%` is a cell.
# A tile that is the last line of a cell shows itself as a shaded relief.

# %%
import json
import os

import numpy as np

from rhytid_client import Client

url = os.environ.get("RHYTID_URL", "http://127.0.0.1:8717")
rhytid = Client(url, key=os.environ.get("RHYTID_KEY"))
file = os.environ.get("RHYTID_MESH", "rhytid-demo/face.npz")
settings = json.loads(os.environ.get("RHYTID_SETTINGS", '{"resolution": 2048}'))

# %%
asset = rhytid.wait(rhytid.create_asset(file, settings=settings))
asset

# %%
udim = asset.udims[0]
neutral = rhytid.map(asset, "neutral", udim)
neutral

# %% [markdown]
# The same of the frame that stretches most, of those that came with the mesh, and what changed.

# %%
strong = max(rhytid.frames(asset), key=lambda frame: frame.log_stretch["abs_p90"]).name
expression = rhytid.map(asset, strong, udim)
expression

# %%
change = expression.array - neutral.array
rms = np.sqrt(np.mean(change**2))
print(f"{strong}: from {change.min():.4g} to {change.max():.4g}, rms {rms:.4g}")

# %% [markdown]
# One scale for both files, so that the same grey is the same height in both.

# %%
scale = float(max(np.abs(tile.array).max() for tile in (neutral, expression)))
for tile in (neutral, expression):
    print(tile.save(".", name="notebook"), tile.save(f"notebook.{tile.label}.png", scale=scale))
