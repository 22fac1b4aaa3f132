"""LZF, the compression inside binary_compressed PCD files (kernels, private)."""

from __future__ import annotations

import numpy as np

from lwrprobe.compiled import allocation_free_kernel as kernel


@kernel
def expand_lzf(packed, plain):
    """Unpack bytes into `plain`; how many came out, -1 where the stream points outside either array.

    A control byte below 32 starts a run of that many plus one literal bytes; any other holds the length, less two, of
    a copy in its top three bits (7: plus the next byte) and the high bits of how far back it lies in the rest.
    """
    read, wrote = 0, 0
    while read < packed.size:
        control = np.int64(packed[read])
        read += 1
        if control < 32:
            count, source = control + 1, read
            if read + count > packed.size or wrote + count > plain.size:
                return -1
            for k in range(count):
                plain[wrote + k] = packed[source + k]
            read += count
        else:
            count = control >> 5
            if read + (2 if count == 7 else 1) > packed.size:
                return -1
            if count == 7:
                count += np.int64(packed[read])
                read += 1
            source = wrote - ((control & 31) << 8) - np.int64(packed[read]) - 1
            read += 1
            count += 2
            if source < 0 or wrote + count > plain.size:
                return -1
            for k in range(count):
                plain[wrote + k] = plain[source + k]
        wrote += count
    return wrote
