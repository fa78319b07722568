import pytest

pytest.importorskip("mujoco", reason="the blind benchmark's plant needs MuJoCo")


@pytest.fixture(scope="session")
def small_case(tmp_path_factory):
    """Folder and key of one case, a torque offset on runs of a few seconds."""
    from concealed import setting
    from concealed.cases import Spec, make_case

    runs = setting.RunSet((("excite", 8), ("task", 8)), (("excite", 6),), (100,), 0.001, 0.004)
    work = tmp_path_factory.mktemp("cases")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(setting.RUN_SETS, "short", runs)
        return work, make_case("x", 4, Spec("single", (("torque_offset", "strong"),), "short"), work)
