from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorSet
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.protobuf import Field, Kind, file_descriptor_set, identifiers

FIELDS = (
    Field("quality", 1, Kind.BYTES),
    Field("bound", 2, Kind.SFIXED64, repeated=True),
    Field("left", 3, Kind.FIXED32),
    Field("joint_1_position", 16, Kind.DOUBLE),
    Field("joint1_position", 2047, Kind.DOUBLE),
)


def test_the_library_understands_the_descriptor():
    described = file_descriptor_set("cellwatt", "frame", FIELDS)
    (file,) = FileDescriptorSet.FromString(described).file
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    frame = message_factory.GetMessageClass(pool.FindMessageTypeByName("cellwatt.frame"))
    assert (file.name, file.package) == ("cellwatt/frame.proto", "cellwatt")
    fields = {f.name: f for f in file.message_type[0].field}
    assert fields["quality"].type == FieldDescriptorProto.TYPE_BYTES
    assert fields["bound"].type == FieldDescriptorProto.TYPE_SFIXED64
    assert fields["bound"].label == FieldDescriptorProto.LABEL_REPEATED and fields["bound"].options.packed
    assert fields["left"].type == FieldDescriptorProto.TYPE_FIXED32
    assert fields["joint1_position"].type == FieldDescriptorProto.TYPE_DOUBLE
    assert [f.number for f in file.message_type[0].field] == [1, 2, 3, 16, 2047]
    assert frame(left=7).SerializeToString() == bytes.fromhex("1d07000000")


def test_names_stay_apart():
    names = identifiers(["joint_1.position", "joint_1_position", "1st", "größe", "quality"], taken=["quality"])
    assert names == ("joint_1_position", "joint_1_position_2", "_1st", "gr__e", "quality_2")


@given(st.lists(st.text(max_size=8), max_size=20))
def test_any_names_become_distinct_identifiers(names):
    made = identifiers(names)
    assert len(set(made)) == len(names)
    assert all(n.isascii() and n.isidentifier() for n in made)
