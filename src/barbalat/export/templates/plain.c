/*
 * ${origin}
 * The controller with plain arguments: its state is stored in ${name}_size() bytes that the caller provides.
 */
#include "${header}"
#include <stddef.h>
#include <string.h>

size_t ${name}_size(void);
unsigned ${name}_plain_step(${name}_controller *c, ${real} sample_time, const ${real} *measured, const ${real} *r, int freeze,
    ${real} *u, ${real} *u_limited, ${real} *theta_hat);

size_t ${name}_size(void)
{
    return sizeof(${name}_controller);
}

unsigned ${name}_plain_step(${name}_controller *c, ${real} sample_time, const ${real} *measured, const ${real} *r, int freeze,
    ${real} *u, ${real} *u_limited, ${real} *theta_hat)
{
    ${name}_input in;
    ${name}_output out;
    in.sample_time = sample_time;
    memcpy(in.${measured}, measured, sizeof in.${measured});
    memcpy(in.r, r, sizeof in.r);
    in.freeze = freeze;
    (void)${name}_step(c, &in, &out);
    memcpy(u, out.u, sizeof out.u);
    memcpy(u_limited, out.u_limited, sizeof out.u_limited);
${estimates}    return out.status;
}
