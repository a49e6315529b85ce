//! Grippers that are switched: a topic of std_msgs/Bool, or a service std_srvs/SetBool; true closes.
//! They tell nothing about their jaws, which are given a time.

use selvedge_math::Jaw;

use crate::call::Call;
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::gripper::Gripper;
use crate::gripper::jaws::Jaws;
use crate::journal::Journal;
use crate::messages::{SetBool, SetBoolReply};
use crate::topic::Out;

/// A gripper with two states.
pub(crate) struct Switch {
    way: Way,
    jaws: Jaws,
    journal: Journal,
    /// When the jaws may be taken to be there.
    done: f64,
}

enum Way {
    Topic(Box<Out<SetBool>>),
    /// And whether an answer is waited for.
    Service(Box<Call<SetBool, SetBoolReply>>, bool),
}

impl Switch {
    pub(crate) fn topic(
        bus: &mut Bus,
        name: &str,
        jaws: Jaws,
        journal: Journal,
    ) -> Result<Self, Error> {
        let out = Out::new(bus, name, ("std_msgs", "Bool"))?;
        Ok(Self::new(Way::Topic(Box::new(out)), jaws, journal))
    }

    pub(crate) fn service(
        bus: &mut Bus,
        name: &str,
        jaws: Jaws,
        journal: Journal,
    ) -> Result<Self, Error> {
        let call = Call::new(bus, name, ("std_srvs", "SetBool"))?;
        Ok(Self::new(
            Way::Service(Box::new(call), false),
            jaws,
            journal,
        ))
    }

    fn new(way: Way, jaws: Jaws, journal: Journal) -> Self {
        Self {
            way,
            jaws,
            journal,
            done: 0.0,
        }
    }
}

impl Gripper for Switch {
    fn prepare(&mut self) -> Result<(), Cause> {
        match &self.way {
            Way::Topic(out) => out.wait(),
            Way::Service(call, _) => call.wait(),
        }
    }

    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause> {
        let data = jaw.is_closed();
        self.journal.event(now, "gripper goal", data.to_string());
        self.done = now + self.jaws.blind;
        match &mut self.way {
            Way::Topic(out) => {
                out.check()?;
                out.send(SetBool { data })
            }
            Way::Service(call, asked) => {
                *asked = true;
                call.send(SetBool { data }, self.jaws.deadline);
                Ok(())
            }
        }
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        if let Way::Service(call, asked) = &mut self.way
            && *asked
        {
            let Some(reply) = call.poll()? else {
                return Ok(false);
            };
            *asked = false;
            self.done = now + self.jaws.blind;
            if !reply.success {
                return Err(Cause::Failed {
                    name: call.name().into(),
                    status: "refused".into(),
                    detail: reply.message,
                });
            }
        }
        Ok(now >= self.done)
    }

    fn cancel(&mut self, now: f64) {
        // There is nothing to take back; the jaws go where they were told to.
        self.done = now;
        if let Way::Service(_, asked) = &mut self.way {
            *asked = false;
        }
    }
}
