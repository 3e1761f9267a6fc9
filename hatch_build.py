"""What is built knows where it comes from: its revision, and the links of its README."""

from __future__ import annotations

import os
import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

# Where the package looks for it, in a wheel and in a source distribution.
_PLACES = {"wheel": "rhytid/revision.txt", "sdist": "service/rhytid/revision.txt"}
# A picture or a link to a file of the repository, in Markdown.
_LINK = re.compile(r"(?P<picture>!?)\[(?P<text>[^\]]*)\]\((?!https?://|#)(?P<path>[^)\s]+)\)")


class RevisionHook(BuildHookInterface[Any]):
    """Adds `revision.txt`: RHYTID_REVISION where it is set, for images are built without a
    repository, else what git says. A source distribution hands the file on to its wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before the files of a target are gathered."""
        revision = os.environ.get("RHYTID_REVISION") or git_revision(Path(self.root))
        if revision and version != "editable":
            self._folder = tempfile.TemporaryDirectory()
            file = Path(self._folder.name) / "revision.txt"
            file.write_text(f"{revision}\n", encoding="utf-8")
            build_data["force_include"][str(file)] = _PLACES[self.target_name]

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Called when the target is written."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()


class PageHook(MetadataHookInterface):
    """README.md and URLs for an index of packages.

    RHYTID_REPOSITORY: the address where the repository can be read. Links and pictures lead there,
    to the revision that is built. Without it, a link becomes its text, and a picture goes.
    """

    def update(self, metadata: dict[str, Any]) -> None:
        """Called with the table `project` of pyproject.toml."""
        repository = os.environ.get("RHYTID_REPOSITORY", "").rstrip("/")
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        revision = git_revision(Path(self.root)).removesuffix("-dirty") or "main"
        page = index_page(text, repository, revision)
        metadata["readme"] = {"content-type": "text/markdown", "text": page}
        metadata["urls"] = {"Paper": "https://doi.org/10.2312/egs.20241016"}
        if repository:
            changes = f"{repository}/blob/{revision}/CHANGELOG.md"
            metadata["urls"] |= {"Repository": repository, "Changelog": changes}


def index_page(text: str, repository: str, revision: str) -> str:
    """A Markdown text whose relative links lead to a repository.  repository: empty where nobody
    can read it."""

    def absolute(link: re.Match[str]) -> str:
        if repository:
            kind = "raw" if link["picture"] else "blob"
            where = f"{repository}/{kind}/{revision}/{link['path']}"
            return f"{link['picture']}[{link['text']}]({where})"
        return "" if link["picture"] else link["text"]

    return _LINK.sub(absolute, text)


def git_revision(root: Path) -> str:
    """Twelve hexadecimal digits, and `-dirty` where files were changed; empty where `root` is not
    the top of a repository, or there is no git."""
    try:
        top = _git(root, "rev-parse", "--show-toplevel")
        if not Path(top).samefile(root):
            return ""
        return _git(root, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), *arguments]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=30)
    return done.stdout.strip()
