//! Checks whether a data set fits a model.

use super::{DataError, Dataset, Experiment, ModelMismatch};
use pid_runtime::dynamics::Dynamics;

impl Dataset {
    /// Checks whether a model can use the data: the same number and kinds of joints, one input per
    /// joint in joint order, inputs in the model's units. Inputs of a controller follow those of
    /// the joints, as many as the records have. Joints are compared by position, base to tip; names
    /// may differ.
    ///
    /// # Errors
    /// [`DataError::Model`] with a [`ModelMismatch`] that names joint or input on both sides.
    pub fn check_model(&self, model: &dyn Dynamics) -> Result<(), DataError> {
        Ok(self.compare(model)?)
    }

    fn compare(&self, model: &dyn Dynamics) -> Result<(), Box<ModelMismatch>> {
        let joints = model.joints();
        if joints.len() != self.joints.len() {
            return Err(Box::new(ModelMismatch::JointCount {
                dataset: self.name.clone(),
                model: model.name().to_owned(),
                data: self.joints.len(),
                data_joints: list(self.joints.iter().map(|j| j.name.as_str())),
                joints: joints.len(),
                model_joints: list(joints.iter().map(|j| j.name.as_ref())),
            }));
        }
        for (i, (data, joint)) in self.joints.iter().zip(joints).enumerate() {
            if data.prismatic != joint.prismatic {
                return Err(Box::new(ModelMismatch::JointKind {
                    number: i + 1,
                    dataset: self.name.clone(),
                    model: model.name().to_owned(),
                    data_joint: data.name.clone(),
                    data: kind(data.prismatic),
                    model_joint: joint.name.to_string(),
                    found: kind(joint.prismatic),
                }));
            }
        }
        let inputs = model.inputs();
        // Further inputs are a controller's; the records then have columns for them.
        let wide = |e: &Experiment| e.nu() == inputs.len();
        let in_order = inputs
            .iter()
            .take(self.joints.len())
            .enumerate()
            .all(|(i, input)| input.joint == Some(i));
        if inputs.len() < self.joints.len() || !in_order || !self.experiments.iter().all(wide) {
            return Err(Box::new(ModelMismatch::InputCount {
                model: model.name().to_owned(),
                inputs: list(inputs.iter().map(|i| i.name.as_ref())),
                columns: self.joints.len(),
            }));
        }
        for (i, (data, input)) in self.joints.iter().zip(inputs).enumerate() {
            if data.input_unit != input.unit {
                return Err(Box::new(ModelMismatch::InputUnit {
                    number: i + 1,
                    dataset: self.name.clone(),
                    quantity: data.input.word(),
                    unit: data.input_unit.clone(),
                    input: input.name.to_string(),
                    model: model.name().to_owned(),
                    expected: input.unit.to_string(),
                }));
            }
        }
        Ok(())
    }
}

fn kind(prismatic: bool) -> &'static str {
    if prismatic { "prismatic" } else { "revolute" }
}

fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}
