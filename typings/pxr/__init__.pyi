"""What mechsim uses of OpenUSD, which comes without types."""

from typing import Any

Gf: Any
Sdf: Any
Tf: Any
Usd: Any
UsdGeom: Any
UsdPhysics: Any
