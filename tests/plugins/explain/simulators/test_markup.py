from pathlib import Path

from cellwatt_plugins.explain.simulators.markup import Markup

TEXT = """<?xml version="1.0"?>
<!-- my arm -->
<mujoco>
  <default><joint damping='3'/></default>
  <body name="a>b">
      <joint name="j"   damping = "1 > 0"
             armature='2'/>   <!-- näher -->
  </body>
  <body name="c"/>
</mujoco>
"""


def test_attributes_change_where_they_stand_and_new_ones_come_last():
    markup = Markup(TEXT, Path("arm.xml"))
    (joint,) = [e for e in markup.root.iter("joint") if e.attributes.get("name") == "j"]
    joint.set(damping="5", frictionloss="7")
    changed = TEXT.replace('"1 > 0"', '"5"').replace("armature='2'/>", "armature='2' frictionloss=\"7\"/>")
    assert markup.text() == changed


def test_children_are_added_to_open_and_to_empty_elements():
    markup = Markup(TEXT, Path("arm.xml"))
    first, second = markup.root.iter("body")
    for body in (first, second):
        body.added.append("<geom/>")
    text = markup.text()
    assert '<body name="a>b">\n    <geom/>\n      <joint' in text
    assert '  <body name="c">\n    <geom/>\n  </body>\n</mujoco>' in text
