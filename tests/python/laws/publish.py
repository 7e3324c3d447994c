"""A law that sends a wrong message from 0.5 s on, of the kind that the scenario names."""

import phalanx

WRONG = {
    "long": lambda law: law.publish(v_m_s=[1.0, 2.0, 3.0], bid=1.0),
    "missing": lambda law: law.publish(v_m_s=[1.0, 2.0]),
    "unknown": lambda law: law.publish(v_m_s=[1.0, 2.0], bid=1.0, price=2.0),
    "nan": lambda law: law.publish(v_m_s=[1.0, float("nan")], bid=1.0),
    "text": lambda law: law.publish(v_m_s="ab", bid=1.0),
    "bytes": lambda law: law.publish(b"ab"),
    "both": lambda law: (law.publish(v_m_s=[1.0, 2.0], bid=1.0), law.withhold()),
    "target": lambda law: law.target((0.0, float("inf"))),
    "signal": lambda law: law.record(costs=1.0),
    "infinite": lambda law: law.record(cost_m2=float("inf")),
    "none": lambda law: None,
    "silent": lambda law: None,
}


class Publish(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        assert (self.robot.name, self.robot.index, self.robot.incarnation) == ("r2", 2, 0)
        assert [(n.name, n.index, n.offset) for n in self.robot.neighbors] == [("r1", 1, (0.0, 0.0))]
        assert self.robot.params["kind"] in WRONG and self.robot.pace == "lockstep"

    def gamma(self, situation):
        if situation.t_s < 0.5 and self.robot.params["kind"] != "silent":
            self.publish(v_m_s=(1.0, 2.0), bid=3)
        else:
            WRONG[self.robot.params["kind"]](self)
        return 0.0, 0.0


phalanx.serve(Publish)
