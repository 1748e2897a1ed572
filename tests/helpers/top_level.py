"""What lies at the top level of the checkout."""

from helpers.scenes import ROOT


def files_on_disk() -> set[str]:
    """Names at the top level, but for those that .gitignore names."""
    lines = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    ignored = {line.strip("/") for line in lines}
    found = {path.name for path in ROOT.iterdir()} - ignored
    return {name for name in found if not name.endswith(".egg-info")}
