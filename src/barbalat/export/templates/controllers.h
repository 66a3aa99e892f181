/*
 * All controllers of this folder. Written by barbalat, and rewritten with each export into the folder.
 */
#ifndef CONTROLLERS_H
#define CONTROLLERS_H

${includes}
#endif
