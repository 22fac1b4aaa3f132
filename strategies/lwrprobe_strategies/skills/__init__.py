"""Compliant motions; see `skill` for what they have in common."""

from lwrprobe_strategies.skills.find_edge import find_edge
from lwrprobe_strategies.skills.follow_and_regain import follow_and_regain
from lwrprobe_strategies.skills.follow_contour import follow_contour
from lwrprobe_strategies.skills.guarded_move import guarded_move
from lwrprobe_strategies.skills.load import approach, load, rest, unload
from lwrprobe_strategies.skills.presses import along_stick, press
from lwrprobe_strategies.skills.reapproach import reapproach
from lwrprobe_strategies.skills.release import release
from lwrprobe_strategies.skills.reorient import reorient
from lwrprobe_strategies.skills.retract import retract
from lwrprobe_strategies.skills.search import search
from lwrprobe_strategies.skills.skill import Procedure, Skill, skill, tried
from lwrprobe_strategies.skills.slide_out import slide_out
from lwrprobe_strategies.skills.spiral_down import spiral_down
from lwrprobe_strategies.skills.transit import transit

__all__ = [
    "Procedure",
    "Skill",
    "along_stick",
    "approach",
    "find_edge",
    "follow_and_regain",
    "follow_contour",
    "guarded_move",
    "load",
    "press",
    "reapproach",
    "release",
    "reorient",
    "rest",
    "retract",
    "search",
    "skill",
    "slide_out",
    "spiral_down",
    "transit",
    "tried",
    "unload",
]
