"""Work for many machines: what is done on a Dask cluster with `--scheduler`, all of it on a shared path."""

from mvtn_cli.core.cluster.cluster import Cluster, cut
from mvtn_cli.core.cluster.connecting import connect

__all__ = ["Cluster", "connect", "cut"]
