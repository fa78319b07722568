"""Skeleton: blocks of rows by HTTP POST."""

from cellwatt.testing.outlet_skeleton.outlet import SkeletonOutlet, SkeletonSettings

__all__ = ["SkeletonOutlet", "SkeletonSettings"]
