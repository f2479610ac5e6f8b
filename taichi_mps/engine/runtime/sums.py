"""Sums over rows: in order by one thread on a processor, divided among the threads of a GPU."""

from .backend import started, ti

GPU_THREADS = 8192  # threads of a GPU among which the rows of a sum are divided
CHUNK = 512  # numbers that one thread of a GPU adds in order


def sum_threads() -> int:
    """Number of threads among which the rows of a sum are divided: 1 on the processor, where rows are added in
    order."""
    return 1 if started()["arch"] == "cpu" else GPU_THREADS


@ti.func
def running_sums(counts: ti.template(), n):
    """counts[k + 1] += counts[k] for k = 0 to n - 1, in this order."""
    if ti.static(sum_threads() == 1):
        ti.loop_config(serialize=True)
        for k in range(n):
            counts[k + 1] += counts[k]
    else:  # inside chunks; then the last number of each chunk; then the others
        chunks = n // CHUNK + 1
        for chunk in range(chunks):
            total = counts[chunk * CHUNK]  # kept here: Vulkan may not see at once what it adds to a field
            for k in range(chunk * CHUNK + 1, ti.min((chunk + 1) * CHUNK, n + 1)):
                total += counts[k]
                counts[k] = total
        for _ in range(1):
            total = counts[ti.min(CHUNK, n + 1) - 1]
            for chunk in range(1, chunks):
                total += counts[ti.min((chunk + 1) * CHUNK, n + 1) - 1]
                counts[ti.min((chunk + 1) * CHUNK, n + 1) - 1] = total
        for k in range(CHUNK, n):
            if (k + 1) % CHUNK != 0:
                counts[k] += counts[k // CHUNK * CHUNK - 1]
