//! Models by their names.

use pid_models::{all, by_name};

#[test]
fn models_are_found_by_their_names() {
    for e in all() {
        assert_eq!(by_name(e.name).unwrap().name(), e.model.name());
    }
    assert_eq!(by_name("two-link").unwrap().name(), "TwoLink");
    assert_eq!(by_name("TwoLink").unwrap().name(), "TwoLink");
}

#[test]
fn an_unknown_name_gets_the_nearest_one() {
    let e = by_name("double_pendlum").err().unwrap();
    assert_eq!(
        e.to_string(),
        "no model named `double_pendlum`, did you mean `double_pendulum`?; the models are two_link, emps, double_pendulum, scara, arm6, ur10e, panda, cart_pole, servo_pendulum, tx40, vs050, vs050_two_axis"
    );
    assert_eq!(by_name("quadruped").err().unwrap().nearest, None);
}
