"""All readers of both tools by name."""

from __future__ import annotations

from tests.fuzz.mapq_readers import READERS as OF_MAPQ
from tests.fuzz.prf_readers import READERS as OF_PRF

READERS = {**OF_PRF, **OF_MAPQ}
