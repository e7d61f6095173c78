"""The epidemic of sir.py as a Mesa model, for Mesa 3.3 and 4.0 (docs/migration/1-mesa.md)."""

import mesa
import numpy as np
from mesa.experimental.continuous_space import ContinuousSpace, ContinuousSpaceAgent


class Person(ContinuousSpaceAgent):
    def __init__(self, model, position, sick):
        super().__init__(model.space, model)
        self.position, self.sick, self.days, self.contacts = position, sick, 0, 0

    def spread(self):
        if self.sick:
            for person in self.get_neighbors_in_radius(1.0)[0]:
                person.contacts += 1

    def live(self):
        caught = self.model.rng.random() > 0.9**self.contacts
        self.contacts = 0
        self.days += self.sick
        self.sick = (self.sick or caught) and self.days <= 20  # After 20 days one is immune.
        self.position = self.position + self.model.rng.normal(0, 0.5, 2)


class Epidemic(mesa.Model):
    def __init__(self, seed):
        super().__init__(rng=seed)
        self.space = ContinuousSpace([[0, 20], [0, 20]], torus=True, random=self.random)
        for number, place in enumerate(np.random.default_rng(1).uniform(0, 20, (2, 200)).T):
            Person(self, place, number < 3)
        reporters = {
            "sick": lambda model: sum(person.sick for person in model.agents),
            "immune": lambda model: sum(person.days > 20 for person in model.agents),
        }
        self.curves = mesa.DataCollector(model_reporters=reporters)
        self.curves.collect(self)

    def step(self):
        self.agents.do("spread").do("live")  # Nobody moves before all have had their contacts.
        self.curves.collect(self)


def simulate(frames, seed):
    model = Epidemic(seed)
    for _ in range(frames):
        model.step()
    return model.curves.get_model_vars_dataframe()


if __name__ == "__main__":
    print(simulate(300, seed=7))
