"""Prints one of README's marked code blocks, such as `run`, `test` or `fea`.

A block is marked by the HTML comment `<!-- ci: NAME -->` on the line before its fence.
"""

import re
import sys
from pathlib import Path

name = sys.argv[1]
readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
blocks = re.findall(rf"<!-- ci: {name} -->\n```\w+\n(.*?)```", readme, flags=re.DOTALL)
if not blocks:
    sys.exit(f"README.md has no block marked <!-- ci: {name} -->")
print("\n".join(blocks))
