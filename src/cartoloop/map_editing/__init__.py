# SPDX-License-Identifier: Apache-2.0
"""Edits of a finished map: what they are, how they are applied, and how they are undone.

The file keeps the map as mapped and the list of edits. What is opened is the map as mapped with the
edits applied that are not undone, in their order, so any of them can be undone at any time.
"""
